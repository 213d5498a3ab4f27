"""From an object and a PSF to the light on the sensor: incoherent, Eq. 2.17 of the thesis.

Objects are given as spectra on an rfft2 grid with the origin in the corner, so that a
disc smaller than a sample is as exact as a photograph.
"""

from __future__ import annotations

import math

import torch

from optics.fourier import irfft2, rfft2
from optics.plane import Plane, centred_crop, centred_pad, origin_to_centre, origin_to_corner
from optics.sensor import pixel_transfer, sample_pixels


def frequencies(plane: Plane) -> tuple[torch.Tensor, torch.Tensor]:
    """Spatial frequencies (y, x) in cycles per metre of the plane's rfft2 grid, float64."""
    fy = torch.fft.fftfreq(plane.shape[0], plane.pitch[0], dtype=torch.float64)
    fx = torch.fft.rfftfreq(plane.shape[1], plane.pitch[1], dtype=torch.float64)
    return fy[:, None], fx[None, :]


def spectrum_of_samples(light: torch.Tensor) -> torch.Tensor:
    """Spectrum of light sampled on a plane, (..., rows, columns), origin at n // 2."""
    return rfft2(origin_to_corner(light))


def spectrum_of_disc(plane: Plane, diameter: float, total: float = 1.0) -> torch.Tensor:
    """Spectrum of a uniform disc at the origin that sends `total` light; diameter in metres."""
    if not 0 <= diameter < math.inf:
        raise ValueError(f"diameter is {diameter:g} m; it can't be negative")
    fy, fx = frequencies(plane)
    argument = math.pi * diameter * torch.hypot(fy, fx)
    safe = torch.where(argument > 0, argument, torch.ones_like(argument))
    jinc = torch.where(argument > 0, 2 * torch.special.bessel_j1(safe) / safe, 1.0)
    return (total * jinc).to(torch.complex128)


def form_image(
    spectrum: torch.Tensor,
    psf: torch.Tensor,
    plane: Plane,
    factor: int,
    shape: tuple[int, int],
    *,
    pixel_aperture: bool = True,
) -> torch.Tensor:
    """Light on each sensor pixel, (rows, columns) of `shape`.

    spectrum: of the object's geometric image on `plane`, which has `factor` samples per
    pixel. psf: (rows, columns) with the same pitch as the plane, origin at n // 2, no
    larger than the plane. The picture wraps around the plane's edges: give it a margin of
    half a PSF around `shape`. Raises ValueError for a spectrum or PSF that doesn't fit.
    """
    expected = (plane.shape[0], plane.shape[1] // 2 + 1)
    if spectrum.shape[-2:] != expected:
        raise ValueError(
            f"spectrum is {tuple(spectrum.shape)}; that of the plane is {expected}, by rfft2"
        )
    kernel = origin_to_corner(centred_pad(psf, plane.shape))
    transfer = rfft2(kernel)
    if pixel_aperture:
        transfer = transfer * pixel_transfer(*plane.shape, factor).to(psf)
    light = irfft2(spectrum.to(transfer) * transfer, plane.shape)
    pixels = sample_pixels(origin_to_centre(light), factor) * factor**2
    return centred_crop(pixels, shape)
