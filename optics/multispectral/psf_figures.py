"""Dispersion power and Fourier coverage, figures of a stack of band PSFs (thesis appendix A.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from optics.inverse.operator import squared_modulus
from optics.validation import require_count, require_finite, require_unmasked

_PERIOD = 128

_NYQUIST = 0.5
"""Highest frequency in cycles per pixel that a row or a column of pixels can show."""


def dispersion_power(psfs: Any) -> float:
    """Compute the dispersion power of band PSFs as the thesis prints it (Eq. A.1).

    It is ``1/N sum_n |I_n|₁ / (|I_{n+1} - I_n|₁ + |I_n - I_{n-1}|₁)``, summed over all bands but
    the first and the last. As printed, it is large where the PSFs of neighbouring bands differ
    little, and (N - 2) / 4 N where they don't overlap, the least value for N PSFs of the same sum:
    a larger dispersion gives a smaller number.

    Parameters
    ----------
    psfs : torch.Tensor or numpy.ndarray, (bands, rows, columns)
        PSF of each band, in the order of wavelengths; three or more.

    Returns
    -------
    float
        The dispersion power, without a unit; infinite where three neighbours are alike.

    Raises
    ------
    ValueError
        For fewer than three bands, values that aren't finite, or a PSF without light.

    References
    ----------
    Thesis Eq. A.1 and Table A.1.
    """
    stack = _as_stack(psfs)
    if len(stack) < 3:
        raise ValueError(f"psfs has {len(stack)} bands; the dispersion power needs 3 or more")
    steps = (stack[1:] - stack[:-1]).abs().sum((1, 2))
    light = stack[1:-1].abs().sum((1, 2))
    return float((light / (steps[1:] + steps[:-1])).sum() / len(stack))


@dataclass(frozen=True, eq=False)
class FourierCoverage:
    """How well a stack of band PSFs transfers spatial frequencies.

    All frequencies are counted whose length is at most 0.5 cycles per pixel.

    Parameters
    ----------
    least_mtf, mean_mtf : torch.Tensor, (bands,), float64
        Least and mean MTF of each band over all frequencies.
    isotropy : torch.Tensor, (bands,), float64
        Squared mean of the MTF over mean of its square, both over the directions of one frequency's
        length, averaged over lengths: 1 where all directions are alike, and less elsewhere.
    similarity : float
        The same over the bands in the place of directions, averaged over all frequencies: 1 where
        all bands have the same MTF.
    """

    least_mtf: torch.Tensor
    mean_mtf: torch.Tensor
    isotropy: torch.Tensor
    similarity: float


def fourier_coverage(psfs: Any, *, period: int = _PERIOD) -> FourierCoverage:
    """Compute how well band PSFs transfer spatial frequencies.

    Parameters
    ----------
    psfs : torch.Tensor or numpy.ndarray, (bands, rows, columns)
        PSF of each band. Its MTF is 1 at the frequency 0, whatever its sum.
    period : int, default 128
        Number of frequencies along each axis, at least the PSFs' rows and columns.

    Returns
    -------
    FourierCoverage
        Least and mean MTF, isotropy, and similarity of the bands.

    Raises
    ------
    ValueError
        For values that aren't finite, a PSF without light, or a period smaller than the PSFs.

    References
    ----------
    Thesis appendix A.1, which asks for a similar and isotropic coverage in all bands.
    """
    stack = _as_stack(psfs)
    require_count("period", period)
    if period < max(stack.shape[1:]):
        raise ValueError(
            f"period is {period}, and psfs are {tuple(stack.shape[1:])}; give their size or more"
        )
    spectrum = squared_modulus(torch.fft.fft2(stack, s=(period, period)))
    mtf = spectrum.sqrt() / stack.sum((1, 2))[:, None, None]
    frequencies = torch.fft.fftfreq(period, dtype=torch.float64)
    length = torch.hypot(frequencies[:, None], frequencies)
    seen = length <= _NYQUIST
    inside = mtf[:, seen]
    squares, tiny = inside.square().mean(0), torch.finfo(mtf.dtype).tiny
    even = torch.where(squares > 0, inside.mean(0).square() / squares.clamp(min=tiny), 1.0)
    isotropy = _isotropy(inside, torch.round(length[seen] * period).to(torch.int64))
    return FourierCoverage(inside.amin(1), inside.mean(1), isotropy, float(even.mean()))


def _as_stack(psfs: Any) -> torch.Tensor:
    """Return PSFs in double precision; raise ValueError unless each sends light."""
    require_unmasked(psfs)
    stack = torch.as_tensor(psfs, dtype=torch.float64)
    if stack.ndim != 3 or not stack.numel():
        raise ValueError(f"psfs is {tuple(stack.shape)}; give (bands, rows, columns)")
    require_finite("psfs", stack)
    for number, light in enumerate(stack.sum((1, 2)).tolist()):
        if not light > 0:
            raise ValueError(f"psfs of band {number} sums to {light:g}; it must send light")
    return stack


def _isotropy(mtf: torch.Tensor, rings: torch.Tensor) -> torch.Tensor:
    """Compute the isotropy of each band's MTF from its frequencies' lengths in steps."""
    count = torch.bincount(rings).to(mtf)
    sums, squares = (
        mtf.new_zeros(len(mtf), len(count)).index_add_(1, rings, one) for one in (mtf, mtf.square())
    )
    # Rings without any light say nothing about directions.
    dark = squares <= 0
    even = (sums.square() / (count * squares.clamp(min=torch.finfo(mtf.dtype).tiny))).clamp(max=1)
    even[dark] = 1.0
    return even.mean(1)
