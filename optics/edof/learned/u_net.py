"""A U-Net that refines what a linear filter restored, applied in tiles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import nn
from torch.nn import functional

from optics.validation import require_count

# Values of a network's finest level in one tile. Measured: with 16 channels of 2 x 2 folded
# pixels tiles have 2048 pixels along a side and take 750 MB; 1024 take a tenth longer and 580 MB.
_TILE_VALUES = 2**24


def tile_side(channels: int, fold: int) -> int:
    """Return the pixels along a side of tiles, so that those of any network take as much memory.

    channels, fold: those of the network's finest level; see `NetworkShape`.
    """
    return math.isqrt(_TILE_VALUES * fold**2 // channels)


def apply_in_tiles(
    function: Callable[[torch.Tensor], torch.Tensor],
    pictures: torch.Tensor,
    multiple: int,
    reach: int,
    tile: int,
) -> torch.Tensor:
    """Apply a function that sees a limited neighbourhood to pictures, tile by tile.

    Each tile is computed with a margin as wide as the neighbourhood, and begins at a multiple of
    the coarsest level's pixels. Its middle therefore is what the function gives for the whole
    picture, apart from the order in which numbers are added.

    function: takes (1, channels, rows, columns), both sides multiples of `multiple`, and gives (1,
        1, rows, columns).
    pictures: (1, channels, rows, columns), of any size; extended by their last pixels.
    reach: pixels from a pixel of the result to the farthest one that decides it.
    tile: pixels along a side of the part of the result that one tile gives.
    """
    rows, columns = pictures.shape[-2:]
    whole = functional.pad(
        pictures, (0, -columns % multiple, 0, -rows % multiple), mode="replicate"
    )
    margin = -(-reach // multiple) * multiple
    side = max(tile // multiple, 1) * multiple
    found = pictures.new_empty(1, 1, *whole.shape[-2:])
    # Slices end where the picture does.
    for top in range(0, whole.shape[-2], side):
        for left in range(0, whole.shape[-1], side):
            bottom, right = top + side, left + side
            upper, before = max(top - margin, 0), max(left - margin, 0)
            cut = whole[..., upper : bottom + margin, before : right + margin]
            middle = function(cut)[
                ..., top - upper : bottom - upper, left - before : right - before
            ]
            found[..., top:bottom, left:right] = middle
    return found[..., :rows, :columns]


@dataclass(frozen=True)
class NetworkShape:
    """The size of a U-Net.

    Parameters
    ----------
    channels, levels : int, optional
        Channels at the finest level, of which each coarser one has twice as many; and levels of
        resolution, 3 or 4 in the thesis.
    fold : int, optional
        Pixels of a side that the finest level folds into channels, so that it works at a `fold`-th
        of the resolution. 1 works on the pixels themselves.
    convolutions : int, optional
        Convolutions of a residual block, 2 or more.
    dilations : tuple of int, optional
        Dilations of the coarsest block's convolutions in turn, instead of 1 everywhere. They widen
        what a pixel of the result sees.
    overlapping : bool, optional
        Whether levels are joined by kernels that overlap, 3 x 3 downwards and 4 x 4 upwards, as in
        the thesis, instead of 2 x 2, which take less time.

    Raises
    ------
    ValueError
        If a number is too small.

    References
    ----------
    Thesis section 5.4 and Fig. 5.3; Ronneberger et al. 2015, doi 10.1007/978-3-319-24574-4_28.
    """

    channels: int = 16
    levels: int = 4
    fold: int = 2
    convolutions: int = 2
    dilations: tuple[int, ...] = ()
    overlapping: bool = False

    def __post_init__(self) -> None:
        for name in ("channels", "levels", "fold", "convolutions"):
            require_count(name, getattr(self, name))
        for one in self.dilations:
            require_count("dilations", one)
        if self.convolutions < 2:
            raise ValueError(
                f"convolutions is {self.convolutions}; choose 2 or more: ReLUs are between them"
            )

    @property
    def multiple(self) -> int:
        """Pixels of which both sides of pictures must be multiples."""
        return self.fold * 2 ** (self.levels - 1)

    @property
    def reach(self) -> int:
        """Most pixels, along an axis, from a pixel of the result to what decides it."""
        reach = 3 * self.fold
        for level in range(self.levels):
            size = self.fold * 2**level
            if level < self.levels - 1:
                reach += 2 * self.convolutions * size
                # Joining two levels reaches to the border of a coarser pixel and, with kernels that
                # overlap, into the next one.
                reach += 2 * (2 * size if self.overlapping else size)
            else:
                reach += sum(self.bottom_dilations) * size
        return reach

    @property
    def bottom_dilations(self) -> tuple[int, ...]:
        """Dilation of each convolution of the coarsest block."""
        return self.dilations or (1,) * self.convolutions

    def as_data(self) -> dict[str, Any]:
        """Return plain data, from which the shape can be made again."""
        return {**asdict(self), "dilations": list(self.dilations)}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> NetworkShape:
        """Make a shape from plain data; ValueError for unknown or missing names."""
        try:
            return cls(**{**data, "dilations": tuple(data.get("dilations", ()))})
        except TypeError as error:
            raise ValueError(f"data isn't the shape of a network: {error}") from None


class UNet(nn.Module):
    """Computes a correction of pictures from some channels of information.

    It has no statistics of batches (unlike the thesis' batch renormalisation), so that a picture is
    decoded alike in any company. A skip connection adds the encoder's values at each level. It
    starts as zero: the last convolution's weights are 0.

    Parameters
    ----------
    shape : NetworkShape
        Its size.
    inputs : int
        Channels of the input.
    """

    def __init__(self, shape: NetworkShape, inputs: int) -> None:
        super().__init__()
        self.shape = shape
        widths = [shape.channels * 2**level for level in range(shape.levels)]
        down, up = ((3, 1), (4, 1)) if shape.overlapping else ((2, 0), (2, 0))
        self.head = nn.Conv2d(inputs * shape.fold**2, widths[0], 3, padding=1)
        plain = (1,) * shape.convolutions
        self.descending = nn.ModuleList(_ResidualBlock(width, plain) for width in widths[:-1])
        self.down = nn.ModuleList(
            nn.Conv2d(fine, coarse, down[0], 2, padding=down[1])
            for fine, coarse in itertools.pairwise(widths)
        )
        self.bottom = _ResidualBlock(widths[-1], shape.bottom_dilations)
        self.up = nn.ModuleList(
            nn.ConvTranspose2d(coarse, fine, up[0], 2, padding=up[1])
            for fine, coarse in itertools.pairwise(widths)
        )
        self.ascending = nn.ModuleList(_ResidualBlock(width, plain) for width in widths[:-1])
        self.tail = nn.Conv2d(widths[0], shape.fold**2, 3, padding=1)
        nn.init.zeros_(self.tail.weight)
        assert self.tail.bias is not None
        nn.init.zeros_(self.tail.bias)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Compute the correction, (pictures, 1, rows, columns).

        pictures: (pictures, inputs, rows, columns), rows and columns multiples of
            ``shape.multiple``.
        """
        head = self.head(_fold(pictures, self.shape.fold))
        values, kept = head, []
        for block, down in zip(self.descending, self.down, strict=True):
            kept.append(block(values))
            values = down(kept[-1])
        values = self.bottom(values)
        for level in reversed(range(len(kept))):
            values = self.ascending[level](self.up[level](values).add_(kept[level]))
        return functional.pixel_shuffle(self.tail(values.add_(head)), self.shape.fold)


class _ResidualBlock(nn.Module):
    """Convolutions of 3 x 3 with a skip connection (He et al. 2016, doi 10.1109/CVPR.2016.90)."""

    def __init__(self, width: int, dilations: tuple[int, ...]) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList(
            nn.Conv2d(width, width, 3, padding=one, dilation=one) for one in dilations
        )

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        # In place, which gradients allow here: no other operation needs what is overwritten.
        found = values
        for number, convolution in enumerate(self.convolutions):
            found = convolution(found.relu_() if number else found)
        result: torch.Tensor = found.add_(values)
        return result


def _fold(pictures: torch.Tensor, fold: int) -> torch.Tensor:
    """Fold squares of pixels into channels, as pixel_unshuffle does.

    The channels come last in memory, in one copy.
    """
    count, channels, rows, columns = pictures.shape
    squares = pictures.reshape(count, channels, rows // fold, fold, columns // fold, fold)
    last = squares.permute(0, 2, 4, 1, 3, 5).reshape(count, rows // fold, columns // fold, -1)
    return last.permute(0, 3, 1, 2)
