"""The Wiener filter (thesis Eq. 2.28), with an unknown border."""

from __future__ import annotations

import torch

from optics.deconvolution.blurred import require_psf
from optics.deconvolution.border import continued
from optics.edge import floating, require_finite, tensors_inside
from optics.fourier import irfft2, rfft2
from optics.operators.blur import blur_shape, transfer_function
from optics.plane import centred_crop, centred_pad
from optics.threads import single_threaded

_BORDER_PASSES = 10
"""Passes after which the surroundings no longer change what lies well inside."""

_SPECTRAL_SLOPE = 2.4
"""Power spectra of natural images fall as frequency to this power, on average
(Tolhurst, Tadmor and Chao 1992, doi 10.1111/j.1475-1313.1992.tb00296.x)."""


@tensors_inside
@single_threaded
def wiener(image: torch.Tensor, psf: torch.Tensor, noise_to_signal: float) -> torch.Tensor:
    """The picture with its blur undone, H* O / (|H|² + K), (rows, columns).

    image: light per pixel. psf: origin at n // 2; its sum is the share of light that
    arrives. noise_to_signal: K, relative to that sum's square; the larger, the smoother;
    best_noise_to_signal() finds one. The mean brightness is set apart, so that K doesn't
    darken it.

    What lies beyond the frame was never measured. It is first the picture's mirror image,
    then what the restored picture predicts there: the expectation-maximisation algorithm
    for missing data (Dempster et al. 1977), whose limit is the filter for the measured
    pixels alone.
    Raises ValueError for a K that isn't positive, or a PSF or picture that isn't finite.
    """
    if not noise_to_signal > 0:
        raise ValueError(f"noise_to_signal is {noise_to_signal:g}; it must be positive")
    require_finite("image", image)
    require_psf(psf)
    image = floating(image)
    shape = blur_shape(image.shape[-2:], psf.shape[-2:])
    transfer = transfer_function(psf.to(image), shape)
    gain, mean = psf.sum().to(image), image.mean()
    power = transfer.real**2 + transfer.imag**2
    inverse = transfer.conj() / (power + noise_to_signal * gain**2)
    measured = centred_pad(torch.ones_like(image), shape) > 0
    detail = centred_pad(image - mean, shape)
    whole = continued(image - mean, shape)
    for _ in range(_BORDER_PASSES):
        predicted = irfft2(rfft2(whole) * inverse * transfer, shape)
        whole = torch.where(measured, detail, predicted)
    restored = irfft2(rfft2(whole) * inverse, shape)
    return centred_crop(restored, image.shape[-2:]) + mean / gain


@tensors_inside
def best_noise_to_signal(image: torch.Tensor, psf: torch.Tensor, variance: torch.Tensor) -> float:
    """The K for wiener() with the least predicted error.

    variance: of the noise of each pixel. The picture's power spectrum is taken to fall
    with frequency as those of natural images do, with the strength that explains the
    blurred picture's variance; the error of every K on a grid of 48, from 1e-7 to 10, is
    summed over all frequencies. Answers 1 for a picture without detail.
    Raises ValueError if no pixel has a finite variance.
    """
    require_finite("image", image)
    require_psf(psf)
    known = torch.isfinite(variance)
    if not known.any():
        raise ValueError("variance has no finite value; no pixel of the picture was measured")
    noise = float(variance[known].mean())
    detail = float(image.to(torch.float64).var(correction=0)) - noise
    if not detail > 0:
        return 1.0
    shape = blur_shape(image.shape[-2:], psf.shape[-2:])
    transfer = transfer_function(psf.to(torch.float64) / psf.sum(), shape)
    power = transfer.real**2 + transfer.imag**2
    fy = torch.fft.fftfreq(shape[0], dtype=torch.float64)[:, None]
    fx = torch.fft.rfftfreq(shape[1], dtype=torch.float64)[None, :]
    frequency = torch.hypot(fy, fx)
    frequency[0, 0] = torch.inf
    spectrum = frequency**-_SPECTRAL_SLOPE
    spectrum *= detail / (power * spectrum).mean()
    grid = torch.logspace(-7, 1, 48, dtype=torch.float64)
    errors = [((k**2 * spectrum + power * noise) / (power + k) ** 2).mean() for k in grid]
    return float(grid[int(torch.argmin(torch.stack(errors)))])
