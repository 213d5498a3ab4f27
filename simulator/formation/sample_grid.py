"""Pictures and kernels on samples of the sensor plane, and from samples to pixels."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
import scipy.fft
import torch
from numpy.typing import NDArray

from optics.camera import Sensor
from optics.formation import rfft2_frequencies
from optics.fourier import fft, irfft2, rfft2
from optics.plane import Plane, centred_crop, origin_to_centre, origin_to_corner
from optics.sensor import pixel_transfer
from simulator.formation.work import transform_operations
from simulator.ledger import Ledger
from simulator.scene.drawable import Drawable

Array = NDArray[np.float64]


class SampleGrid:
    """The samples of a picture: the sensor with what may shine on it.

    min_shape: pixels of the picture, (rows, columns), as many as the sensor's at least.
    samples_per_pixel: along each axis. picture_samples_per_pixel: the same of pictures, before
    what is finer than the others is left out. check: is called before every transform, and may
    raise.

    Spectra are on its rfft2 grid, complex64, with the origin in the corner. What a PSF carries
    around the plane's edges stays outside the sensor.
    """

    def __init__(
        self,
        sensor: Sensor,
        min_shape: tuple[int, int],
        samples_per_pixel: int,
        ledger: Ledger,
        picture_samples_per_pixel: int = 1,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        shape = tuple(scipy.fft.next_fast_len(n, real=True) for n in min_shape)
        self.sensor, self.finer, self._ledger, self._check = (
            sensor,
            samples_per_pixel,
            ledger,
            check,
        )
        self._pixels = (shape[0], shape[1])
        self.plane: Plane = sensor.window_plane(self._pixels).with_finer_pitch(samples_per_pixel)
        self._drawn = self.plane.with_finer_pitch(
            math.ceil(picture_samples_per_pixel / samples_per_pixel)
        )

    @property
    def operations(self) -> float:
        """Of one transform of all samples."""
        return transform_operations(*self.plane.shape)

    def _count(self, effect: str) -> None:
        self._check()
        self._ledger.add(effect, self.operations, 8 * math.prod(self.plane.shape))

    def zero_spectra(self, count: int) -> list[torch.Tensor]:
        """Spectra of no light."""
        rows, columns = self.plane.shape
        return [torch.zeros(rows, columns // 2 + 1, dtype=torch.complex64) for _ in range(count)]

    def spectrum(
        self, picture: Drawable, magnification: float, shift: tuple[float, float], effect: str
    ) -> torch.Tensor:
        """Of a picture, moved by (y, x) metres on the object."""
        if picture.has_exact_spectrum or self._drawn == self.plane:
            self._count(effect)
            return picture.spectrum(self.plane, magnification, shift).to(torch.complex64)
        rows, columns = self._drawn.shape
        self._ledger.add(effect, transform_operations(rows, columns), 8 * rows * columns)
        spectrum = picture.spectrum(self._drawn, magnification, shift).to(torch.complex64)
        return _crop_spectrum(spectrum, self._drawn.shape, self.plane.shape)

    def samples(self, spectrum: torch.Tensor, effect: str) -> torch.Tensor:
        """The picture of a spectrum, (rows, columns) of the plane."""
        self._count(effect)
        return origin_to_centre(irfft2(spectrum, self.plane.shape))

    def transform_samples(self, samples: torch.Tensor, effect: str) -> torch.Tensor:
        """The spectrum of a picture on the plane."""
        self._count(effect)
        return rfft2(origin_to_corner(samples)).to(torch.complex64)

    def transfers(
        self, psfs: Sequence[torch.Tensor], weights: Array, effect: str
    ) -> list[torch.Tensor]:
        """Transfer functions of weighted sums of PSFs; weights: (sums, PSFs).

        Sums are formed before the transform or behind it, whichever takes fewer of them.
        """
        if len(psfs) <= len(weights):
            known = [self._transfer(psf, effect) for psf in psfs]
            return [_sum(known, row) for row in weights]
        return [self._transfer(_sum(psfs, row), effect) for row in weights]

    def _transfer(self, psf: torch.Tensor, effect: str) -> torch.Tensor:
        self._count(effect)
        return _transform_centred_part(psf.to(torch.float32), self.plane.shape)

    def motion_transfer(self, path: tuple[float, float]) -> torch.Tensor | None:
        """What a straight path on the sensor, (y, x) metres, makes of a spectrum; None if none."""
        if not any(path):
            return None
        fy, fx = rfft2_frequencies(self.plane)
        return torch.sinc(fy * path[0] + fx * path[1]).to(torch.float32)

    @cached_property
    def _aperture(self) -> torch.Tensor:
        return pixel_transfer(*self.plane.shape, self.finer).to(torch.float32)

    def light_on_pixels(self, spectrum: torch.Tensor, aperture: bool) -> torch.Tensor:
        """Light on the sensor's pixels, (rows, columns): its mean over each, or at its centre."""
        if aperture:
            self._ledger.add("pixel aperture", 2.0 * spectrum.numel(), 4 * spectrum.numel())
            spectrum = spectrum * self._aperture
        light = downsample_spectrum(spectrum, self._pixels, self.finer)
        self._ledger.add("picture", transform_operations(*self._pixels), 4 * light.numel())
        return centred_crop(origin_to_centre(light), self.sensor.shape)


def _transform_centred_part(part: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """The rfft2 of a picture of some shape that is 0 but for a part around its origin, n // 2 of
    both: rows without light aren't transformed."""
    (rows, columns), (y, x) = part.shape, (n // 2 for n in part.shape)
    lines = np.zeros((rows, shape[1]), dtype=np.float32)
    lines[:, : columns - x] = part[:, x:]
    lines[:, shape[1] - x :] = part[:, :x]
    lit = scipy.fft.rfft(lines, axis=1)
    whole = torch.zeros((shape[0], lit.shape[1]), dtype=torch.complex64)
    whole[: rows - y] = torch.from_numpy(lit[y:])
    whole[shape[0] - y :] = torch.from_numpy(lit[:y])
    return fft(whole, shape[0], 0, overwrite=True)


def _crop_spectrum(
    spectrum: torch.Tensor, shape: tuple[int, int], new_shape: tuple[int, int]
) -> torch.Tensor:
    """The rfft2 of a picture of `new_shape` samples that has what these resolve of one of more, and
    nothing that is finer."""
    rows, columns = new_shape
    half = (rows + 1) // 2
    kept = torch.cat([spectrum[:half], spectrum[shape[0] - (rows - half) :]])
    samples = shape[0] * shape[1] / (rows * columns)
    return (kept[:, : columns // 2 + 1] / samples).contiguous()


def downsample_spectrum(
    spectrum: torch.Tensor, shape: tuple[int, int], factor: int
) -> torch.Tensor:
    """Every `factor`th sample, from the origin on, of a picture whose rfft2 is given, (rows,
    columns) of shape with the origin in the corner: frequencies that look alike are added before
    they are transformed."""
    if factor == 1:
        return irfft2(spectrum, shape)
    rows, columns = shape
    lines = spectrum.reshape(factor, rows, spectrum.shape[1]).sum(0) / factor
    # Now a real picture's spectrum along x alone: what is beyond its end is known by symmetry.
    lines = fft(lines, rows, 0, inverse=True)
    kept = columns // 2 + 1
    total = torch.zeros((rows, kept), dtype=lines.dtype)
    whole = factor * columns
    for k in range(factor):
        first = k * columns
        index = torch.arange(first, first + kept)
        beyond = index > whole // 2
        part = lines[:, torch.where(beyond, whole - index, index)]
        total += torch.where(beyond, part.conj(), part)
    picture = scipy.fft.irfft(total.resolve_conj().numpy() / factor, columns, axis=1)
    return torch.from_numpy(picture)


def _sum(parts: Sequence[torch.Tensor], weights: Array) -> torch.Tensor:
    first, *others = (float(w) * part for part, w in zip(parts, weights, strict=True))
    return sum(others, first)
