"""The samples of the sensor plane: spectra of pictures and PSFs, and the light on pixels."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
import scipy.fft
import torch
from numpy.typing import NDArray

from optics.camera import Sensor
from optics.fourier import fft, irfft2, rfft, rfft2
from optics.plane import Plane, centred_crop, origin_to_centre, origin_to_corner
from optics.sensor import pixel_transfer
from simulator.formation.windows import transform_operations
from simulator.ledger import Ledger
from simulator.recipe import Recipe
from simulator.scene.drawable import Drawable

Array = NDArray[np.float64]


class SampleGrid:
    """The samples of a picture, on the sensor and on a margin whose light may be blurred into it.

    min_shape: fewest pixels of the picture, (rows, columns), at least the sensor's. check: is
    called before every transform, and may raise. Detail finer than the recipe's samples of light is
    removed. Spectra are on the rfft2 grid, complex64, with the origin in the corner. Light that a
    PSF carries periodically around the plane's edges doesn't reach the sensor.
    """

    def __init__(
        self,
        sensor: Sensor,
        min_shape: tuple[int, int],
        recipe: Recipe,
        ledger: Ledger,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        shape = tuple(scipy.fft.next_fast_len(n, real=True) for n in min_shape)
        self.sensor, self._ledger, self._check = sensor, ledger, check
        self.finer = recipe.light_samples_per_pixel
        self._pixels = (shape[0], shape[1])
        pixels = sensor.window_plane(self._pixels)
        self.plane: Plane = pixels.with_finer_pitch(self.finer)
        drawn = recipe.picture_samples_per_pixel or self.finer
        self._drawn = self.plane.with_finer_pitch(math.ceil(drawn / self.finer))
        self._of_psfs = pixels.with_finer_pitch(recipe.samples_per_pixel)

    @property
    def operations(self) -> float:
        """Return the operations of one Fourier transform of the samples."""
        return transform_operations(*self.plane.shape)

    def _count(self, effect: str) -> None:
        """Enter one Fourier transform in the ledger."""
        self._check()
        self._ledger.add(effect, self.operations, 8 * math.prod(self.plane.shape))

    def zero_spectra(self, count: int) -> list[torch.Tensor]:
        """Return `count` spectra without light."""
        rows, columns = self.plane.shape
        return [torch.zeros(rows, columns // 2 + 1, dtype=torch.complex64) for _ in range(count)]

    def spectrum(
        self, picture: Drawable, magnification: float, shift: tuple[float, float], effect: str
    ) -> torch.Tensor:
        """Draw a picture and return its spectrum.

        shift: (y, x) metres on the object.
        """
        if picture.has_exact_spectrum or self._drawn == self.plane:
            self._count(effect)
            return picture.spectrum(self.plane, magnification, shift).to(torch.complex64)
        rows, columns = self._drawn.shape
        self._ledger.add(effect, transform_operations(rows, columns), 8 * rows * columns)
        spectrum = picture.spectrum(self._drawn, magnification, shift).to(torch.complex64)
        # Detail finer than the samples resolve is left out.
        kept_rows, kept_columns = self.plane.shape
        samples = rows * columns / (kept_rows * kept_columns)
        kept = _low_rows(spectrum, kept_rows)[:, : kept_columns // 2 + 1]
        return (kept / samples).contiguous()

    def samples(self, spectrum: torch.Tensor, effect: str) -> torch.Tensor:
        """Transform a spectrum to its samples, (rows, columns)."""
        self._count(effect)
        return origin_to_centre(irfft2(spectrum, self.plane.shape))

    def transform_samples(self, samples: torch.Tensor, effect: str) -> torch.Tensor:
        """Transform samples to their spectrum."""
        self._count(effect)
        return rfft2(origin_to_corner(samples)).to(torch.complex64)

    def transfers(
        self, psfs: Sequence[torch.Tensor], weights: Array, effect: str
    ) -> list[torch.Tensor]:
        """Return the transfer functions of weighted sums of PSFs.

        weights: (sums, PSFs). Sums are formed before or after the transform, whichever needs fewer.
        """
        if len(psfs) <= len(weights):
            known = [self.transfer(psf, effect) for psf in psfs]
            return [_weighted_sum(known, row) for row in weights]
        return [self.transfer(_weighted_sum(psfs, row), effect) for row in weights]

    def transfer(self, psf: torch.Tensor, effect: str) -> torch.Tensor:
        """Return the transfer function of one PSF."""
        self._count(effect)
        return _transform_centred_part(psf.to(torch.float32), self._of_psfs.shape, self.plane.shape)

    @cached_property
    def _aperture(self) -> torch.Tensor:
        """Return the transfer function of the pixel aperture."""
        return pixel_transfer(*self.plane.shape, self.finer).to(torch.float32)

    def light_on_pixels(self, spectrum: torch.Tensor, aperture: bool) -> torch.Tensor:
        """Return the light on the sensor's pixels, (rows, columns).

        aperture: whether the light is averaged over each pixel, or taken at its centre.
        """
        if aperture:
            self._ledger.add("pixel aperture", 2.0 * spectrum.numel(), 4 * spectrum.numel())
            spectrum = spectrum * self._aperture
        light = downsample_spectrum(spectrum, self._pixels, self.finer)
        self._ledger.add("picture", transform_operations(*self._pixels), 4 * light.numel())
        return centred_crop(origin_to_centre(light), self.sensor.shape)


def _transform_centred_part(
    part: torch.Tensor, shape: tuple[int, int], kept: tuple[int, int]
) -> torch.Tensor:
    """Transform a PSF that is zero except for a part around its origin, by rfft2.

    The part's origin is at n // 2 along both axes. Rows without light aren't transformed. shape: of
    the whole PSF. kept: of as large a plane with no more samples, whose frequencies the result has.
    """
    lit = rfft(_from_origin(part, shape[1], 1))[:, : kept[1] // 2 + 1]
    whole = _from_origin(lit, shape[0], 0)
    # At most two arrays of the whole PSF are in memory.
    del lit
    return _low_rows(fft(whole, shape[0], 0, overwrite=True), kept[0])


def _from_origin(part: torch.Tensor, length: int, dim: int) -> torch.Tensor:
    """Return a part along an axis of `length`, from its origin at n // 2 on, and 0 elsewhere."""
    count = part.shape[dim]
    before = count // 2
    shape = list(part.shape)
    shape[dim] = length
    whole = part.new_zeros(shape)
    whole.narrow(dim, 0, count - before).copy_(part.narrow(dim, before, count - before))
    whole.narrow(dim, length - before, before).copy_(part.narrow(dim, 0, before))
    return whole


def _low_rows(spectrum: torch.Tensor, rows: int) -> torch.Tensor:
    """Return the lowest frequencies along y of a spectrum, so many in the same order."""
    if len(spectrum) == rows:
        return spectrum
    half = (rows + 1) // 2
    return torch.cat([spectrum[:half], spectrum[len(spectrum) - (rows - half) :]])


def downsample_spectrum(
    spectrum: torch.Tensor, shape: tuple[int, int], factor: int
) -> torch.Tensor:
    """Transform an rfft2 to every `factor`th sample, (rows, columns) of `shape`.

    The samples begin at the origin, which is in the corner. Frequencies that are aliases of each
    other are added before the transform.
    """
    if factor == 1:
        return irfft2(spectrum, shape)
    rows, columns = shape
    lines = spectrum.reshape(factor, rows, spectrum.shape[1]).sum(0) / factor
    # The lines are now spectra along x of a real picture: values beyond the rfft's end follow by
    # symmetry.
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


def _weighted_sum(parts: Sequence[torch.Tensor], weights: Array) -> torch.Tensor:
    first, *others = (
        part if w == 1 else float(w) * part for part, w in zip(parts, weights, strict=True)
    )
    return sum(others, first)
