"""Capture a scene through a PSF as the evaluation protocol says, with noise."""

from __future__ import annotations

import math

import torch

from optics.edof.detector_psf import compute_transfer
from optics.edof.protocol import EdofProtocol
from optics.edof.spectral_criterion import noise_at_light
from optics.fourier import fast_fft_length, irfft2, rfft2
from optics.plane import centred_crop, centred_pad
from optics.validation import require_positive


class SceneBlur:
    """Computes noiseless images of scenes through one PSF, on the pixels of captures.

    Parameters
    ----------
    kernel : torch.Tensor, (rows, columns)
        PSF on detector pixels, origin at n // 2.
    protocol : EdofProtocol
        Whether the image wraps around the crop, or takes in light from beyond it.

    Raises
    ------
    ValueError
        If the PSF reaches farther than the protocol's window.
    """

    def __init__(self, kernel: torch.Tensor, protocol: EdofProtocol) -> None:
        self._side, self._crop = protocol.scene_side, protocol.crop
        reach = max(n // 2 for n in kernel.shape)
        if protocol.border == "true" and reach > protocol.kernel_reach:
            raise ValueError(
                f"kernel reaches {reach} pixels; the protocol's window allows "
                f"{protocol.kernel_reach}"
            )
        self._border = protocol.border
        period = self._side if self._border == "periodic" else fast_fft_length(self._side)
        self._shape = (period, period)
        self._transfer = compute_transfer(kernel, self._shape)

    def __call__(self, scene: torch.Tensor) -> torch.Tensor:
        """Compute the noiseless image (crop, crop) of a scene of the protocol's `scene_side`."""
        if tuple(scene.shape) != (self._side, self._side):
            raise ValueError(
                f"scene is {tuple(scene.shape)}; with a {self._border} border and a crop of "
                f"{self._crop} the protocol needs {self._side} x {self._side}"
            )
        # With a true border, what wraps around stays in the margin, as wide as the PSF's reach.
        spectrum = rfft2(centred_pad(scene, self._shape)) * self._transfer
        return centred_crop(irfft2(spectrum, self._shape), (self._crop, self._crop))


def add_noise(
    image: torch.Tensor,
    deviation: float,
    collected: float,
    generator: torch.Generator,
    shot_share: float = 0.0,
) -> torch.Tensor:
    """Add the noise of a capture to an image, more of it where the pattern collects less light.

    The capture is scaled up to the brightness of one with the full aperture. With the share T of
    the light, read noise therefore has the standard deviation `deviation` / T, and photon noise has
    the variance of the full aperture's over T.

    Parameters
    ----------
    image : torch.Tensor, (rows, columns)
        Noiseless image relative to the collected light: white is 1.
    deviation : float
        Standard deviation of a white pixel with the full aperture. Positive.
    collected : float
        Share T of the open pupil's light that is collected, above 0 and up to 1.
    generator : torch.Generator
        Source of the random numbers.
    shot_share : float, default 0
        Share of a white pixel's variance with the full aperture that is photon noise, 0 to 1. It is
        Gaussian here, with a variance proportional to the light.

    Returns
    -------
    torch.Tensor, (rows, columns)
        The capture. It isn't clipped.

    Raises
    ------
    ValueError
        If a number is out of range.
    """
    require_positive("deviation", deviation, "")
    white = noise_at_light(deviation, collected, shot_share)
    normal = torch.randn(image.shape, generator=generator, dtype=torch.float32).to(image)
    if not shot_share:
        return image + white * normal
    read = noise_at_light(deviation * math.sqrt(1 - shot_share), collected)
    shot_variance = (white**2 - read**2) * image.clamp(min=0.0)
    variance = read**2 + shot_variance
    # Photons alone leave darkness without noise, where the root has no finite slope.
    noisy = variance > 0
    deviations = torch.where(noisy, variance, 1.0).sqrt()
    return image + torch.where(noisy, deviations, 0.0) * normal
