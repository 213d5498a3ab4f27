"""Scale patterns of extreme amplitudes for a PSF, so that single precision holds their light."""

from __future__ import annotations

import numpy as np
import torch

_LEAST_PEAK = 1e-12
"""Peak amplitude below which, or above whose inverse, its square may exceed the range of single
precision, also in a dim window."""

_BRIGHTEST_PEAK = 1e150
"""Largest amplitude whose light, and sums of it, double precision holds."""

_DARKEST_PEAK = 1e-150
"""Peak amplitude whose square is near the smallest number of double precision."""


def normalise_amplitude(
    amplitude: torch.Tensor | None, sample_axes: int
) -> tuple[torch.Tensor | None, torch.Tensor | None]:
    """Scale the amplitude of every pattern in a batch to a peak of 1 for its PSF.

    Returns the amplitude and the old peaks, one for each pattern, float64. The peaks are None if
    they are all 1. A pattern whose amplitude is zero, not finite, or so small that double precision
    doesn't hold its square, keeps it, with a peak of 1.
    sample_axes: number of axes at the end that hold one pattern.
    """
    if amplitude is None or not amplitude.numel():
        return amplitude, None
    axes = tuple(range(-min(sample_axes, amplitude.ndim), 0))
    peak = _peak(amplitude.detach(), axes)
    if bool((peak.isfinite() & (peak > _BRIGHTEST_PEAK)).any()):
        raise ValueError(
            f"amplitude reaches {float(peak.max()):.3g}; its light, the square, is more than "
            f"doubles hold: give one of at most {_BRIGHTEST_PEAK:g}"
        )
    peak = torch.where((peak > _DARKEST_PEAK) & peak.isfinite(), peak, 1.0)
    if bool((peak == 1).all()):
        return amplitude, None
    if _is_extreme(peak):
        # Numbers near the end of single precision's range lose digits, or become NaN in a division.
        wide = torch.complex128 if amplitude.is_complex() else torch.float64
        amplitude, peak = amplitude.to(wide), peak.to(torch.float64)
    return amplitude * peak.reciprocal(), peak.squeeze(axes).to(torch.float64)


def _peak(amplitude: torch.Tensor, axes: tuple[int, ...]) -> torch.Tensor:
    """Return the largest modulus of every pattern whose PSF is computed."""
    if amplitude.device.type != "cpu":
        return amplitude.abs().amax(axes, keepdim=True)
    # numpy computes the moduli of complex numbers in an eighth of torch's time.
    moduli = np.abs(amplitude.resolve_conj().resolve_neg().numpy())
    return torch.from_numpy(np.asarray(moduli.max(axes, keepdims=True)))


def scale_light(light: torch.Tensor, peak: torch.Tensor | None) -> torch.Tensor:
    """Scale the PSF of normalise_amplitude() back, by the squares of the amplitudes' peaks.

    The result is float64 where single precision might not hold it.
    """
    if peak is None:
        return light
    wide = light.to(torch.float64) if _is_extreme(peak) else light
    return wide * (peak**2).to(wide)[..., None, None]


def _is_extreme(peak: torch.Tensor) -> bool:
    """Tell whether single precision might not hold the PSF of amplitudes with these peaks."""
    return bool((peak < _LEAST_PEAK).any() or (peak > 1 / _LEAST_PEAK).any())
