"""The neural network of plug-and-play deconvolution, which removes white noise from pictures."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import nn
from torch.nn import functional

from optics.deconvolution.band_coupling import transform_bands

MULTIPLE = 8
"""The sides of the network's pictures must be multiples of this number of samples."""


class _ResidualBlock(nn.Module):
    """A residual block of the denoiser: two convolutions with a skip connection.

    See He et al. 2016, doi 10.1109/CVPR.2016.90.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.second = nn.Conv2d(width, width, 3, padding=1, bias=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        answer: torch.Tensor = x + self.second(torch.relu(self.first(x)))
        return answer


def _blocks(width: int) -> nn.Sequential:
    """Build the two residual blocks that a deconvolution denoiser has at each resolution."""
    return nn.Sequential(*(_ResidualBlock(width) for _ in range(2)))


class Denoiser(nn.Module):
    """A neural network that removes white noise of a given level from grey pictures.

    It is a U-net (Ronneberger et al. 2015, doi 10.1007/978-3-319-24574-4_28) of residual blocks.
    The pictures are rearranged to four channels at half resolution, and a further channel holds
    the noise level (Zhang et al. 2018, doi 10.1109/TIP.2018.2839891). The network has no additive
    constants, so that a picture and a noise level that are twice as large give a result twice as
    large. Therefore it generalises to noise levels on which it wasn't trained (Mohan et al. 2020,
    arXiv 1906.05478).
    """

    def __init__(self) -> None:
        super().__init__()
        # Numbers of channels at a half, a quarter and an eighth of the picture's resolution.
        fine, middle, coarse = 32, 64, 96
        self.head = nn.Conv2d(5, fine, 3, padding=1, bias=False)
        self.fine_in = _blocks(fine)
        self.to_middle = nn.Conv2d(fine, middle, 2, 2, bias=False)
        self.middle_in = _blocks(middle)
        self.to_coarse = nn.Conv2d(middle, coarse, 2, 2, bias=False)
        self.coarse = _blocks(coarse)
        self.from_coarse = nn.ConvTranspose2d(coarse, middle, 2, 2, bias=False)
        self.middle_out = _blocks(middle)
        self.from_middle = nn.ConvTranspose2d(middle, fine, 2, 2, bias=False)
        self.fine_out = _blocks(fine)
        self.tail = nn.Conv2d(fine, 4, 3, padding=1, bias=False)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, pictures: torch.Tensor, level: torch.Tensor) -> torch.Tensor:
        """Denoise a batch of pictures; plug-and-play deconvolution does this in each iteration.

        The batch is (pictures, 1, rows, columns), with rows and columns that are multiples of 8.
        `level` is the standard deviation of the noise: of each picture, (pictures,), or of each
        pixel.
        """
        folded = functional.pixel_unshuffle(pictures, 2)
        if level.ndim == 4:
            told = functional.avg_pool2d(level, 2)
        else:
            told = level[:, None, None, None].expand(-1, 1, *folded.shape[-2:])
        whole = torch.cat([folded, told], dim=1).contiguous(memory_format=torch.channels_last)
        head = self.head(whole)
        fine = self.fine_in(head)
        middle = self.middle_in(self.to_middle(fine))
        coarse = self.coarse(self.to_coarse(middle))
        middle = self.middle_out(self.from_coarse(coarse) + middle)
        fine = self.fine_out(self.from_middle(middle) + fine)
        return pictures - functional.pixel_shuffle(self.tail(fine + head), 2)

    @torch.no_grad()
    def denoise(
        self,
        picture: torch.Tensor,
        noise: float | torch.Tensor,
        axes: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Denoise the components of a picture, for plug-and-play deconvolution: see Denoise.

        The picture may have any size. Components of several bands are shifted and scaled to the
        range from 0 to 1, on which the network was trained.
        """
        rows, columns = picture.shape[-2:]
        bands = picture.reshape(-1, rows, columns)
        components = bands if axes is None else transform_bands(axes, bands)
        low, unit = torch.zeros(()), torch.ones(())
        if axes is not None:
            low = components.amin((-2, -1), keepdim=True).clamp_(max=0)
            unit = (components.amax((-2, -1), keepdim=True) - low).clamp_(min=1e-6)
        levels = (torch.as_tensor(noise).to(picture) / unit).expand_as(components)
        more = (0, -columns % MULTIPLE, 0, -rows % MULTIPLE)
        filled, told = (
            functional.pad(one[:, None].float(), more, mode="replicate")
            for one in ((components - low) / unit, levels)
        )
        # One component after the other takes less memory, and no more time.
        answer = torch.cat(
            [self(one[None], level[None]) for one, level in zip(filled, told, strict=True)]
        )
        found = answer[:, 0, :rows, :columns].to(picture) * unit + low
        return (found if axes is None else transform_bands(axes.mT, found)).reshape(picture.shape)


def load_denoiser(weights: Mapping[str, torch.Tensor]) -> Denoiser:
    """Build the denoiser of plug-and-play deconvolution with trained weights, for inference.

    The keys of `weights` are those of Denoiser.state_dict(). Raises ValueError if a weight is
    missing, isn't expected, or has another shape.
    """
    network = Denoiser()
    try:
        network.load_state_dict({name: value.to(torch.float32) for name, value in weights.items()})
    except RuntimeError as error:
        raise ValueError(f"weights don't fit the denoiser: {error}") from None
    return network.requires_grad_(False).eval()
