"""Form an image on the sensor from an object and a PSF, incoherent and coherent.

Thesis Eq. 2.16 and 2.17. In incoherent imaging, objects are spectra on an rfft2 grid with the
origin in the corner, so that a disc smaller than a sample is as exact as a photograph. In
coherent imaging they are complex fields, sample by sample.
"""

from __future__ import annotations

import math

import scipy.fft
import torch

from optics.fourier import fft, irfft2, rfft2
from optics.plane import Plane, centred_crop, centred_pad, origin_to_centre, origin_to_corner
from optics.sensor import pixel_transfer, sample_pixels
from optics.validation import accepts_numpy, require_amount, require_finite


def rfft2_frequencies(plane: Plane) -> tuple[torch.Tensor, torch.Tensor]:
    """Return a plane's spatial frequencies (y, x) for rfft2, cycles per metre, float64."""
    fy = torch.fft.fftfreq(plane.shape[0], plane.pitch[0], dtype=torch.float64)
    fx = torch.fft.rfftfreq(plane.shape[1], plane.pitch[1], dtype=torch.float64)
    return fy[:, None], fx[None, :]


def spectrum_of_samples(light: torch.Tensor) -> torch.Tensor:
    """Compute the rfft2 spectrum of light (..., rows, columns) whose origin is at n // 2."""
    return rfft2(origin_to_corner(light))


def spectrum_of_disc(plane: Plane, diameter: float, total: float = 1.0) -> torch.Tensor:
    """Compute the rfft2 spectrum of a uniform disc, a diameter in metres, at the origin."""
    require_amount("diameter", diameter, "m")
    fy, fx = rfft2_frequencies(plane)
    argument = math.pi * diameter * torch.hypot(fy, fx)
    safe = torch.where(argument > 0, argument, torch.ones_like(argument))
    jinc = torch.where(argument > 0, 2 * torch.special.bessel_j1(safe) / safe, 1.0)
    return (total * jinc).to(torch.complex128)


def form_image(
    spectrum: torch.Tensor,
    psf: torch.Tensor,
    plane: Plane,
    samples_per_pixel: int,
    shape: tuple[int, int],
    *,
    pixel_aperture: bool = True,
) -> torch.Tensor:
    """Compute the light on each sensor pixel in incoherent imaging, (rows, columns) of `shape`.

    spectrum: of the object's geometric image on `plane`. psf: (rows, columns) of the plane's pitch,
    origin at n // 2, no larger than the plane. The picture wraps around the plane's edges, so the
    plane needs a margin of half a PSF around `shape`. Raises ValueError for a spectrum or PSF that
    doesn't fit.
    """
    expected = (plane.shape[0], plane.shape[1] // 2 + 1)
    if spectrum.shape[-2:] != expected:
        raise ValueError(
            f"spectrum is {tuple(spectrum.shape)}; that of the plane is {expected}, by rfft2"
        )
    require_finite("psf", psf)
    require_finite("spectrum", spectrum)
    kernel = origin_to_corner(centred_pad(psf, plane.shape))
    transfer = rfft2(kernel)
    if pixel_aperture:
        transfer = transfer * pixel_transfer(*plane.shape, samples_per_pixel).to(psf)
    light = irfft2(spectrum.to(transfer) * transfer, plane.shape)
    pixels = sample_pixels(origin_to_centre(light), samples_per_pixel) * samples_per_pixel**2
    return centred_crop(pixels, shape)


@accepts_numpy
def form_coherent_image(
    field: torch.Tensor, amplitude_psf: torch.Tensor, shape: tuple[int, int] | None = None
) -> torch.Tensor:
    """Compute the intensity ``|p * U|²`` of coherent imaging (thesis Eq. 2.16), real.

    The result is (..., `shape`). field: U, the object's geometric image, complex, (..., rows,
    columns); its squared modulus is the light on a sample. amplitude_psf: p, the field that a point
    makes, complex, (..., rows, columns) of any size with the same pitch. Both have their origin at
    n // 2, and their leading axes broadcast. The share sum |p|² of a point's light reaches the
    picture. Fields are added before they are squared, so that the share of a whole object may be
    larger or smaller. The convolution is computed in complex64, or in complex128 if one of the two
    is in double precision. It is differentiable.

    The convolution is linear: nothing wraps around, and the field is dark beyond its edges.
    shape: rows and columns of the central part that is returned; by default those of the field.
    Give the field a margin of half an amplitude_psf, because the rim of the picture otherwise
    lacks the light from outside. The intensity has fringes twice as fine as those of the field.
    Integrate pixels by optics.sensor.integrate_pixels() on samples that resolve the fringes.

    Raises ValueError for shapes that don't fit, and for numbers that aren't finite.
    """
    for name, wave in (("field", field), ("amplitude_psf", amplitude_psf)):
        if wave.ndim < 2 or wave.numel() == 0:
            raise ValueError(f"{name} is {tuple(wave.shape)}; give (..., rows, columns)")
        require_finite(name, wave)
    sizes = zip(field.shape[-3::-1], amplitude_psf.shape[-3::-1], strict=False)
    if not all(a == b or 1 in (a, b) for a, b in sizes):
        raise ValueError(
            f"field is {tuple(field.shape)} and amplitude_psf is {tuple(amplitude_psf.shape)}; "
            "their leading axes must be alike, or 1"
        )
    dtype = torch.promote_types(
        torch.promote_types(field.dtype, amplitude_psf.dtype), torch.complex64
    )
    sides = [sum(pair) - 1 for pair in zip(field.shape[-2:], amplitude_psf.shape[-2:], strict=True)]
    rows, columns = (scipy.fft.next_fast_len(n) for n in sides)

    def spectrum(wave: torch.Tensor) -> torch.Tensor:
        return fft(fft(wave.to(dtype), columns, -1), rows, -2)

    image = spectrum(field) * spectrum(amplitude_psf)
    # Only the rows that are needed are transformed along x.
    y, x = (n // 2 for n in amplitude_psf.shape[-2:])
    image = fft(image, rows, -2, inverse=True)[..., y : y + field.shape[-2], :]
    image = fft(image, columns, -1, inverse=True)[..., x : x + field.shape[-1]]
    return centred_crop(image.real**2 + image.imag**2, shape or field.shape[-2:])
