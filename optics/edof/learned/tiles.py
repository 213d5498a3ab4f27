"""Apply a network to pictures of any size in tiles whose borders can't be seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import torch
from torch.nn import functional

_TILE_VALUES = 2**24
"""Values of a network's finest level in one tile. Measured: with 16 channels of 2 x 2 folded pixels
tiles have 2048 pixels along a side and take 750 MB; 1024 take a tenth longer and 580 MB."""


def tile_side(channels: int, fold: int) -> int:
    """Return the pixels along a side of a network's tiles, so that any network's take as much.

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

    Parameters
    ----------
    function : callable
        Takes (1, channels, rows, columns), both sides multiples of `multiple`, and gives
        (1, 1, rows, columns).
    pictures : torch.Tensor, (1, channels, rows, columns)
        Pictures of any size.
    multiple : int
        Pixels of which the sides must be multiples.
    reach : int
        Pixels from a pixel of the result to the farthest one that decides it.
    tile : int
        Pixels along a side of the part of the result that one tile gives.

    Returns
    -------
    torch.Tensor, (1, 1, rows, columns)
        The result.
    """
    rows, columns = pictures.shape[-2:]
    whole = _extend(pictures, multiple)
    margin = -(-reach // multiple) * multiple
    side = max(tile // multiple, 1) * multiple
    found = pictures.new_empty(1, 1, *whole.shape[-2:])
    for top, bottom in _parts(whole.shape[-2], side):
        for left, right in _parts(whole.shape[-1], side):
            upper, before = max(top - margin, 0), max(left - margin, 0)
            cut = whole[..., upper : bottom + margin, before : right + margin]
            middle = function(cut)[
                ..., top - upper : bottom - upper, left - before : right - before
            ]
            found[..., top:bottom, left:right] = middle
    return found[..., :rows, :columns]


def _extend(pictures: torch.Tensor, multiple: int) -> torch.Tensor:
    """Extend pictures to the right and below by their last pixels, to multiples of a length."""
    more = [-n % multiple for n in pictures.shape[-2:]]
    if not any(more):
        return pictures
    return functional.pad(pictures, (0, more[1], 0, more[0]), mode="replicate")


def _parts(length: int, side: int) -> Iterator[tuple[int, int]]:
    """Yield the first and last-but-one pixel of the tiles of a length, about equally long.

    side: most pixels of a tile.
    """
    for start in range(0, length, side):
        yield start, min(start + side, length)
