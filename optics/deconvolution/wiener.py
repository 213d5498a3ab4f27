"""The Wiener filter (thesis Eq. 2.28)."""

from __future__ import annotations

import torch

from optics.deconvolution.border import continued, padded_shape, require_psf, transfer_function
from optics.edge import require_finite, tensors_inside
from optics.plane import centred_crop


@tensors_inside
def wiener(image: torch.Tensor, psf: torch.Tensor, noise_to_signal: float) -> torch.Tensor:
    """The picture with its blur undone, H* O / (|H|² + K), (rows, columns).

    image: light per pixel. psf: origin at n // 2; its sum is the share of light that
    arrives. noise_to_signal: K, the power of the noise over that of the picture's detail;
    see noise_to_signal(). The mean brightness is set apart, so that K doesn't darken it.
    Raises ValueError for a K that isn't positive, or a PSF or picture that isn't finite.
    """
    if not noise_to_signal > 0:
        raise ValueError(f"noise_to_signal is {noise_to_signal:g}; it must be positive")
    require_finite("image", image)
    require_psf(psf)
    shape = padded_shape(image.shape[-2:], psf.shape[-2:])
    transfer = transfer_function(psf.to(image), shape)
    gain = psf.sum().to(image)
    mean = image.mean()
    spectrum = torch.fft.rfft2(continued(image - mean, shape))
    inverse = transfer.conj() / (transfer.real**2 + transfer.imag**2 + noise_to_signal * gain**2)
    restored = torch.fft.irfft2(spectrum * inverse, s=shape)
    return centred_crop(restored, image.shape[-2:]) + mean / gain


@tensors_inside
def noise_to_signal(image: torch.Tensor, variance: torch.Tensor) -> float:
    """K for wiener(): mean noise variance over the variance of the picture without it.

    The picture was blurred, which took variance from it, so this K errs on the smooth side.
    """
    noise = float(variance[torch.isfinite(variance)].mean())
    signal = float(image.var()) - noise
    smallest = 1e-8
    return max(noise / signal, smallest) if signal > 0 else 1.0
