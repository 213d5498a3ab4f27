"""Compute images of layered scenes, in which near layers hide parts of those behind them.

A pixel of the image sees a layer's matte a through the pupil: each point of the pupil looks at
another place of the layer, displaced by the defocus there. The share of the pupil that the layer
covers is therefore the matte, blurred by the layer's PSF of sum 1. What lies behind is dimmed by
the rest. From the nearest layer 1 to the farthest:

    I = H1 (a1 L1) + (1 - C1 a1) (H2 (a2 L2) + (1 - C2 a2) (H3 (a3 L3) + ...))

L is a layer's light, H its blur and C = H / H(0) the blur by the PSF of sum 1. The formula is the
over operator of Porter and Duff with a blur of every layer. It takes the part of the pupil that is
covered to be independent of which ray of the background arrives there. It is exact where either is
the same over the whole pupil: for a background in focus or of constant light, and where the PSF
reaches no edge of a matte.

A PSF on a window has a sum H(0) below 1, as some light falls beyond. That light is lost from every
layer's image alone. The share of the pupil that a matte covers isn't light: a matte of 1 covers it
all, so that the background vanishes, whatever the window. C is H / H(0) for that reason, which
takes the rays beyond the window to meet the matte as often as those within.

T. Porter, T. Duff, "Compositing digital images", Computer Graphics 18, 253, 1984, doi
10.1145/964965.808606; S. W. Hasinoff, K. N. Kutulakos, "A layer-based restoration framework for
variable-aperture photography", IEEE Int. Conf. Computer Vision, 2007, doi
10.1109/ICCV.2007.4408898.
"""

from __future__ import annotations

import torch

from optics.fourier import irfft2, rfft2
from optics.validation import accepts_numpy, as_floating_point, require_finite


@accepts_numpy
def composite_layers(
    pictures: torch.Tensor, mattes: torch.Tensor, transfers: torch.Tensor
) -> torch.Tensor:
    """Compute the noiseless image of layers that hide each other, each blurred by its own PSF.

    Pictures are periodic; for a right border, give layers with a margin as wide as the PSFs' reach,
    and crop the image. It is (..., rows, columns), and differentiable in all arguments.

    L layers take 2 (2 L - 1) Fourier transforms: one takes 2, as a plane does, and two take 6.
    Measured on a processor with 128 to 512 pixels along a side: two layers take 2.3 to 2.7 times as
    long as one, and 2.6 to 3.0 times with the gradient in the transfer functions.

    Raises ValueError for layers or transfer functions that can't be.

    pictures: linear light of each layer, (..., layers, rows, columns), the nearest first, also
        where another layer hides it.
    mattes: share of each pixel that a layer covers, (..., layers, rows, columns), 0 to 1. The
        farthest layer's is 1.
    transfers: transfer function of each layer's depth on the frequencies of `torch.fft.rfft2`,
        (..., layers, rows, columns // 2 + 1), complex, with the PSF's origin at the first pixel.
        Its value at zero frequency is the PSF's sum, above 0.
    """
    pictures, mattes = as_floating_point(pictures), as_floating_point(mattes)
    _require_layers(pictures, mattes)
    _require_transfers(pictures, transfers)
    shape = (pictures.shape[-2], pictures.shape[-1])
    # One layer at a time: transforms of a whole stack took 10 to 25 % longer on a CPU.
    image = irfft2(rfft2(pictures[..., -1, :, :]) * transfers[..., -1, :, :], shape)
    for layer in reversed(range(pictures.shape[-3] - 1)):
        matte, transfer = mattes[..., layer, :, :], transfers[..., layer, :, :]
        light = irfft2(rfft2(matte * pictures[..., layer, :, :]) * transfer, shape)
        # The covered share of the pupil isn't light, so that what the window loses doesn't count.
        covered = irfft2(rfft2(matte) * transfer, shape) / transfer[..., :1, :1].real
        image = light + (1 - covered) * image
    return image


@accepts_numpy
def flatten_layers(pictures: torch.Tensor, mattes: torch.Tensor) -> torch.Tensor:
    """Compute the sharp picture of layers that hide each other: what a perfect lens would show.

    Arguments and errors are as for `composite_layers`; the picture is (..., rows, columns).
    """
    pictures, mattes = as_floating_point(pictures), as_floating_point(mattes)
    _require_layers(pictures, mattes)
    flat = pictures[..., -1, :, :]
    for layer in reversed(range(pictures.shape[-3] - 1)):
        flat = torch.lerp(flat, pictures[..., layer, :, :], mattes[..., layer, :, :])
    return flat


def _require_layers(pictures: torch.Tensor, mattes: torch.Tensor) -> None:
    if pictures.ndim < 3 or 0 in pictures.shape[-3:]:
        raise ValueError(
            f"pictures is {tuple(pictures.shape)}; give (..., layers, rows, columns) with at least "
            "one layer"
        )
    if mattes.shape != pictures.shape:
        raise ValueError(
            f"mattes is {tuple(mattes.shape)} and pictures {tuple(pictures.shape)}; give each "
            "layer a matte of its picture's shape"
        )
    require_finite("pictures", pictures)
    low, high = (float(one) for one in torch.aminmax(mattes.detach()))
    # A comparison with NaN is false.
    if not (low >= 0 and high <= 1):
        raise ValueError(
            f"mattes goes from {low:g} to {high:g}; give the share of a pixel that is covered, "
            "from 0 to 1"
        )
    farthest = float(mattes[..., -1, :, :].detach().min())
    if farthest < 1:
        raise ValueError(
            f"mattes of the farthest layer, the last one, go down to {farthest:g}; give 1 "
            "everywhere, as nothing is behind it"
        )


def _require_transfers(pictures: torch.Tensor, transfers: torch.Tensor) -> None:
    """Raise ValueError if transfer functions don't fit the layers, or let no light by."""
    layers, rows, columns = pictures.shape[-3:]
    shape = (layers, rows, columns // 2 + 1)
    if not transfers.is_complex() or tuple(transfers.shape[-3:]) != shape:
        kind = "complex" if transfers.is_complex() else "real"
        raise ValueError(
            f"transfers is {kind} {tuple(transfers.shape)}; give a complex transfer function for "
            f"each layer, (..., {layers}, {rows}, {columns // 2 + 1})"
        )
    sums = transfers[..., 0, 0].detach().real
    require_finite("transfers", sums)
    if not bool((sums > 0).all()):
        raise ValueError(
            f"transfers is {float(sums.min()):g} at zero frequency; give PSFs with a positive sum"
        )
