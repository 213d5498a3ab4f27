"""Estimate the light that lands in the frame, on cells of pixels: patterns may send it elsewhere.

Estimates are relative to this light. A steep grating, a lens or a star beside the frame leave less
in it than the sharp picture tells, and most of what is left may lie far from the light's image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.convolution import convolve_valid
from simulator.effects.psf_bounds import is_uniform_scene
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.spectra import spectral_measure
from simulator.formation.nodes import gauss_quadrature
from simulator.formation.windows import max_blur_distance
from simulator.probing.far_field import cut_kernel
from simulator.probing.picture_probe import MARGIN
from simulator.situation import Situation

Array = NDArray[np.float64]

# Cells along the frame's longer side, and nodes of the band, for estimates of light. Chosen.
_CELLS, _WAVELENGTHS = 48, 3

# Ratio of the frame's light with blur and without, from which on most of it is elsewhere. Chosen:
# beyond it, errors relative to all light mislead.
_MOVED = 1.6


@dataclass(frozen=True, eq=False)
class LandedLight:
    """The light in the frame by cells, after the blur of the shown pattern, without other losses.

    cells: electrons per second and pixel, of cells so many `pixels` wide.
    """

    cells: Array
    pixels: int

    @property
    def total(self) -> float:
        """Return the electrons per second that land in the frame."""
        return float(self.cells.sum()) * self.pixels**2

    @property
    def norm(self) -> float:
        """Return the L2 norm over the frame's pixels of the light that cells resolve."""
        return float(np.linalg.norm(self.cells)) * self.pixels


def cell_pixels(s: Situation) -> int:
    """Return the sensor pixels along a cell on which estimates of light are computed."""
    return max(1, math.ceil(max(s.camera.sensor.shape) / _CELLS))


def landed_light(s: Situation) -> LandedLight | None:
    """Estimate the light that lands in the frame; None where blur doesn't move any."""
    return None if s.picture_probe.is_dark or is_uniform_scene(s) else _blurred_light(s)


def is_light_moved(s: Situation) -> bool:
    """Whether blur takes much of the light out of the frame, or brings most of what is in it."""
    landed, sharp = landed_light(s), s.picture_probe.total
    return landed is not None and not sharp / _MOVED <= landed.total <= sharp * _MOVED


def detail_factor(s: Situation, finest: float = 0.0) -> float:
    """Return the norm of blurred light with detail from a frequency on, over what cells resolve.

    Copies in the panel's orders are blurred like the picture itself, so that what is finer than
    cells has the same share everywhere.
    finest: cycles per metre.
    """
    on_cells = _blurred_norm(s, 0.0, 0.5 / (cell_pixels(s) * s.camera.sensor.pitch))
    return _blurred_norm(s, finest, math.inf) / on_cells if on_cells else 1.0


def _blurred_norm(s: Situation, low: float, high: float) -> float:
    """Estimate the norm of the blurred light from its frequencies in a range, cycles per metre."""
    power = s.picture_probe.power_spectrum
    passed = s.pattern_probe.transfer_bounds.mean_square_between(power.low, power.high)
    inside = (power.low >= low) & (power.low < high)
    return math.sqrt(float((power.power * passed)[inside].sum()))


@cached_across_exposures
def _blurred_light(s: Situation) -> LandedLight:
    """Blur the sharp picture by the PSFs of a few wavelengths, all diffraction orders included."""
    step = cell_pixels(s)
    cell, found = step * s.camera.sensor.pitch, None
    # No light is known to come from farther away than beyond the frame's margin.
    known = (max(s.camera.sensor.shape) + MARGIN) * s.camera.sensor.pitch
    far = [min(one, known) for one in max_blur_distance(s)]
    y, x = (math.ceil(one / cell) for one in far)
    # That of the band's shortest wavelength comes from farther away in the kernel.
    reach = math.hypot(*far) * s.wavelength / s.band.support[0] + cell
    for kernel in s.pattern_probe.blur_kernels(cell, reach):
        near = kernel_over_band(s, kernel, (y, x))
        down, along = (n // 2 for n in near.shape)
        landed = convolve_valid(_in_cells(s, step, (down, along)), near)
        found = landed if found is None else np.minimum(found, landed)
    assert found is not None
    return LandedLight(np.maximum(found, 0.0) / step**2, step)


def kernel_over_band(s: Situation, kernel: Array, half: tuple[int, int]) -> Array:
    """Average how a pattern's light spreads over the band, in the sensor's axes.

    An offset is proportional to the wavelength.
    kernel: at the band's centre and in the panel's axes, as of order_kernel().
    half: cells (y, x) on each side of the middle that are returned, or all that the kernel has.
    """
    found = spectral_measure(s, "band")
    scales, shares = np.ones(1), np.ones(1)
    if not found.is_empty:
        nodes, weights = gauss_quadrature(found.wavelengths, found.electrons, _WAVELENGTHS)
        masses = weights.sum((0, 1))
        scales, shares = nodes / s.wavelength, masses / masses.sum()
    still = float(np.abs(scales - 1).max()) * max(half) < 0.5
    if still and s.mount.is_aligned:
        return cut_kernel(kernel, half)
    if still:
        scales, shares = np.ones(1), np.ones(1)
    most = math.ceil((len(kernel) // 2) * max(scales) * (1 if s.mount.is_aligned else math.sqrt(2)))
    own = min(half[0], most), min(half[1], most)
    blurs = (
        share * _on_sensor(s, kernel, float(scale), own)
        for scale, share in zip(scales, shares, strict=True)
    )
    return np.asarray(sum(blurs))


def _in_cells(s: Situation, step: int, half: tuple[int, int]) -> Array:
    """Sum the sharp picture in cells of the frame, and of `half` cells on each side of it."""
    light = s.picture_probe.sharp_picture.clamp(min=0).numpy()
    for axis, (n, more) in enumerate(zip(s.camera.sensor.shape, half, strict=True)):
        # Beyond its margin, the picture isn't known, and counts as dark.
        around = min(more, MARGIN // step)
        count = math.ceil(n / step) + 2 * around
        first = MARGIN - around * step
        light = np.take(light, np.arange(first, min(first + count * step, light.shape[axis])), axis)
        starts = np.arange(0, light.shape[axis], step)
        light = np.add.reduceat(light, starts, axis, dtype=np.float64)
        missing = count - light.shape[axis]
        dark = [(more - around, more - around + missing) if k == axis else (0, 0) for k in (0, 1)]
        light = np.pad(light, dark)
    return np.asarray(light)


def _on_sensor(s: Situation, kernel: Array, scale: float, half: tuple[int, int]) -> Array:
    """Turn a kernel to the sensor's axes and scale it; see kernel_over_band() for the rest."""
    most = math.ceil(math.hypot(*half) / min(scale, 1.0)) + 1
    near = cut_kernel(kernel, (most, most))
    down, along = (np.arange(n) - n // 2 for n in near.shape)
    places = np.meshgrid(scale * down, scale * along, indexing="ij")
    y, x = s.mount.places_on_sensor(*places)
    shape = 2 * half[0] + 1, 2 * half[1] + 1
    turned = np.zeros(shape)
    rows, columns = np.floor(y).astype(np.intp), np.floor(x).astype(np.intp)
    for one in (0, 1):
        for other in (0, 1):
            share = near * abs(1 - one - (y - rows)) * abs(1 - other - (x - columns))
            row, column = rows + one + half[0], columns + other + half[1]
            inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
            place = row[inside] * shape[1] + column[inside]
            turned += np.bincount(place, share[inside], turned.size).reshape(shape)
    return turned
