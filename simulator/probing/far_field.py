"""The far field behind a panel: one period of its diffraction orders, and the lens' part in it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TypeVar

import numpy as np
import scipy.fft
import scipy.sparse
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array

from optics.caching import ByteCache
from optics.camera import Camera
from optics.camera.pupil import object_to_lens_distance, pupil_amplitude
from optics.fourier import NonuniformTransform, fft
from optics.plane import Plane
from optics.validation import as_number
from optics.zernike import zernike

Array = NDArray[np.float64]
Light = NDArray[np.float32]
T = TypeVar("T")

# Error of a transfer function between the samples of its grid, as a share of all light. Chosen.
_TRANSFER_ERROR = 1e-6

# Cycles per sample from which on the transfer function of light with fewer than two samples a
# diffraction spot fades out. Chosen.
_ALIAS_FREE = 0.35


class FarField:
    """The far-field irradiance of a field on the panel, by samples in each diffraction spot.

    It is |Fourier transform of the field|², with a sum of 1. Distances are in shares of a period.
    Raises ValueError if no light passes the stop.
    light: the irradiance over one period of the panel's diffraction orders along each axis, (rows,
        columns), with the optical axis at index (0, 0).
    side: side of a pixel's open area over the pitch.
    samples_per_spot: 2 along each axis resolve the irradiance. Fewer take less work, and alias its
        transfer function near the cut-off; 1 would lie between the fringes of an open panel.
    """

    def __init__(self, field: torch.Tensor, side: float, samples_per_spot: float = 2) -> None:
        rows, columns = (math.ceil(samples_per_spot * n) for n in field.shape)
        far = fft(fft(field, columns, -1), rows, -2).numpy()
        # Work in place: most of the time would be spent on fresh memory.
        light = np.abs(far)
        light *= light
        total = light.sum(dtype=np.float64)
        if not total > 0:
            raise ValueError("no light passes the stop: open it, or move it before the panel")
        self._top = _peak_intensity(far, light, samples_per_spot) / total
        light *= np.float32(1 / total)
        self.light: Light = light
        self._side, self._samples_per_spot = side, samples_per_spot

    @property
    def bytes(self) -> int:
        """Return the bytes of the light, its zeroth order, and the transfer function."""
        return 2 * self.light.nbytes + 16 * _frequency_count(self.light.shape) ** 2

    def envelope(self, axis: int, order: int = 0) -> Array:
        """Return the envelope of one pixel of the panel in an order, along an axis, (samples,)."""
        return self._envelope_at(np.fft.fftfreq(self.light.shape[axis]) + order)

    def _envelope_at(self, places: NDArray[np.floating]) -> Array:
        """Return one pixel's envelope along an axis at places in shares of a period."""
        return np.asarray(self._side * np.sinc(self._side * places) ** 2)

    def order_share(self, orders: int) -> float:
        """Return the share of the light in the orders from -orders to orders."""
        every = range(-orders, orders + 1)
        down, across = (sum(self.envelope(axis, one) for one in every) for axis in (0, 1))
        along = self.light @ np.asarray(across).astype(np.float32)
        return float(along.astype(np.float64) @ np.asarray(down))

    @cached_property
    def peak(self) -> float:
        """Return the peak irradiance times a period's area, over all light."""
        return float(self._top * self._side**2 * self.light.size)

    @cached_property
    def zeroth_order_light(self) -> Light:
        """Return the light of the zeroth diffraction order."""
        down, along = (self.envelope(axis).astype(np.float32) for axis in (0, 1))
        light = self.light * down[:, None]
        light *= along
        return light

    def light_around_axis(self, reach: tuple[int, int]) -> Light:
        """Return the light around the optical axis, over all orders, (2 y, 2 x) samples."""
        light: NDArray[np.float32] = self.light
        for axis, most in enumerate(reach):
            samples, period = np.arange(-most, most), self.light.shape[axis]
            along = self._envelope_at(samples / period).astype(np.float32)
            light = np.take(light, samples, axis, mode="wrap")
            light *= along if axis else along[:, None]
        return light

    def transfer_at(
        self, ky: Array, kx: Array, period: float, half: tuple[float, float]
    ) -> NDArray[np.complex128]:
        """Return the transfer function at frequencies (ky, kx), cycles/m.

        It is 0 at frequencies that the panel doesn't resolve, and fades out where light with fewer
        than two samples a spot doesn't tell it.
        period: metres on the sensor between diffraction orders.
        half: half sides (y, x) in metres of the part of the PSF that is transformed, with up to two
            side orders. Of few samples, which are for estimates with large panels, they are left
            out: they are far aside.
        """
        reached = math.ceil(min(max(half) / period - 0.5, 2.0))
        most = max(reached, 0) if self._samples_per_spot == 2 else 0
        pitch = period / self.light.shape[0], period / self.light.shape[1]
        y, x = (
            math.ceil(min(aside / step + 1, (2 * most + 1) * n // 2))
            for aside, step, n in zip(half, pitch, self.light.shape, strict=True)
        )
        light = self.light_around_axis((y, x))
        known = (abs(ky) * pitch[0] < 0.5) & (abs(kx) * pitch[1] < 0.5)
        found = np.zeros(known.shape, dtype=np.complex128)
        series = NonuniformTransform(
            torch.from_numpy(ky[known]), torch.from_numpy(kx[known]), Plane(light.shape, pitch),
            1.0, _TRANSFER_ERROR, few_points=True,
        )  # fmt: skip
        found[known] = series.adjoint(torch.from_numpy(light)).numpy()
        if self._samples_per_spot < 2:
            for k, step in ((ky, pitch[0]), (kx, pitch[1])):
                ramp = np.clip((0.5 - abs(k) * step) / (0.5 - _ALIAS_FREE), 0, 1)
                found *= np.sin(np.pi / 2 * ramp) ** 2
        return found

    def _ensquared_sums(self, light: Light) -> Array:
        """Sum light in squares around the axis, for each size of square.

        The half side of square k is k + 1/2 steps. A step is the distance of the samples along the
        shorter axis.
        """
        down, across = (_ring_sums(n, min(light.shape) // 2) for n in light.shape)
        # A ring has up to four samples along an axis, for which single precision suffices. The sums
        # over many samples need double precision.
        rings = across @ np.ascontiguousarray((down @ light).T)
        return np.asarray(np.diagonal(rings.astype(np.float64).cumsum(0).cumsum(1)))

    @cached_property
    def ensquared_share(self) -> Array:
        """Return the share of the zeroth order's light within squares; see _ensquared_sums()."""
        total = self._ensquared_sums(self.zeroth_order_light)
        return np.asarray(total / total[-1])

    @cached_property
    def beyond_energy(self) -> Array:
        """Integrate the squared density of the zeroth order outside squares around the axis.

        The squares are those of ensquared_share. The integral is relative to that of uniform light
        over the period, and exact, because the density is sampled at its Nyquist rate.
        """
        total = self._squared_sums
        return np.asarray(self.light.size * np.maximum(total[-1] - total, 0.0))

    @cached_property
    def energy(self) -> float:
        """Integrate the zeroth order's squared density over the period; 1 for uniform light."""
        return float(self.light.size * self._squared_sums[-1])

    @cached_property
    def _squared_sums(self) -> Array:
        """Return the sums of the zeroth order's squared light, as in _ensquared_sums()."""
        return self._ensquared_sums(self.zeroth_order_light**2)

    @cached_property
    def transfer(self) -> NDArray[np.complex64]:
        """Return the transfer function of the zeroth order at the frequencies of radii()."""
        spectrum = scipy.fft.rfft2(self.zeroth_order_light)
        kept = _frequency_count(self.light.shape)
        return np.asarray(np.concatenate([spectrum[:kept, :kept], spectrum[-kept + 1 :, :kept]]))


def _peak_intensity(far: NDArray[np.complex64], light: Light, samples_per_spot: float) -> float:
    """Return the peak irradiance of a far field, also between its samples."""
    most = float(light.max())
    # Light may be brighter half a sample away: for two samples a spot, by a factor of sinc(1/4)^-4,
    # which is below 1.6.
    brighter = 1.05 * float(np.sinc(0.5 / samples_per_spot)) ** -4
    places = np.flatnonzero(light > most / brighter)
    # Only few candidates are interpolated. Of more than 64, some are so close to the top of a
    # fringe that a quarter of that suffices (audited).
    if len(places) > 64:
        return (1 + (brighter - 1) / 4) * most
    # The amplitude between samples is interpolated from four samples on either side.
    taps = 4
    span = np.arange(-taps, taps + 1)
    between = np.linspace(-0.5, 0.5, 5)[:, None] - span
    weights = np.sinc(between) * np.cos(np.pi * between / (2 * taps + 2)) ** 2
    # The field begins at the first sample of the transformed array. The offset of its centre is a
    # phase ramp in the far field, which is removed here.
    turns = [np.exp(1j * np.pi * span * (1 / samples_per_spot - 1 / n)) for n in far.shape]
    for y, x in zip(*np.unravel_index(places, light.shape), strict=True):
        rows, columns = (y + span) % far.shape[0], (x + span) % far.shape[1]
        patch = far[np.ix_(rows, columns)] * turns[0][:, None] * turns[1]
        most = max(most, float(np.abs(weights @ patch @ weights.T).max()) ** 2)
    return most


def _frequency_count(shape: tuple[int, ...]) -> int:
    """Return a transfer function's frequencies from 0 on, half those of the shorter axis."""
    return min(shape) // 2


def radii(shape: tuple[int, ...]) -> Array:
    """Return the frequency moduli of a far field's transfer function, cycles per period."""
    kept = _frequency_count(shape)
    down = np.concatenate([np.arange(kept), np.arange(-kept + 1, 0)])
    return np.hypot(down[:, None], np.arange(kept))


@lru_cache(maxsize=16)
def _ring_sums(samples: int, steps: int) -> scipy.sparse.csr_array:
    """Return the matrix that sums samples along an axis over rings, (steps + 1, samples).

    Ring k contains distances from the optical axis at sample 0 above k - 1 steps, up to k steps.
    """
    sample = np.arange(samples)
    away = np.minimum(sample, samples - sample) * (2 * steps / samples)
    ring = np.minimum(np.ceil(away - 1e-9), steps).astype(int)
    ones = np.ones(samples, np.float32)
    return scipy.sparse.csr_array((ones, (ring, sample)), shape=(steps + 1, samples))


def side_order_kernel(
    far: FarField, period: float, cell: float, lowest: int, highest: int, fade: float = 0.0
) -> Array:
    """Return how a far field spreads a point's light over side orders; see order_kernel().

    lowest, highest: range of the orders' numbers: of the larger of both along y and x.
    fade: metres over which the order below the lowest fades into it, at most a period.
    """
    outer = order_kernel(far, period, cell, highest)
    inner = order_kernel(far, period, cell, lowest - 1, min(fade, period))
    more = (len(outer) - len(inner)) // 2
    part = slice(more, len(outer) - more)
    outer[part, part] -= inner
    return outer


def order_kernel(
    far: FarField,
    period: float,
    cell: float,
    highest: int,
    fade: float = 0.0,
    reach: float = math.inf,
) -> Array:
    """Return the share of a point's light in each cell, by the panel's diffraction orders.

    All orders are copies of the far field, times the envelope of one pixel of the panel. The result
    is (cells, cells), an odd number, with the point's image in the middle cell.
    period: distance between two orders on the sensor, metres.
    cell: side of a cell, metres.
    highest: largest number of an order along y or x.
    fade: metres over which the outermost orders fade out, half of them in the next ones.
    reach: metres to either side beyond which light isn't needed.
    """
    half = math.ceil(min((highest + 0.5) * period + fade / 2, reach) / cell)
    down, across = (
        _cells_of_samples(far, axis, period / cell, highest, half, fade / period) for axis in (0, 1)
    )
    return np.asarray(across @ (down @ far.light).T).T.astype(np.float64)


def cut_kernel(kernel: Array, half: tuple[int, int]) -> Array:
    """Cut a kernel to `half` cells (y, x) on each side of its middle."""
    middle = len(kernel) // 2
    y, x = (min(cells, middle) for cells in half)
    return kernel[middle - y : middle + y + 1, middle - x : middle + x + 1]


def _cells_of_samples(
    far: FarField, axis: int, cells_per_period: float, most: int, half: int, fade: float
) -> csr_array:
    """Return the envelope of each sample of a far field in each cell, (cells, samples).

    Every sample stands for one place in each order from -most to most along the axis.
    fade: share of a period over which the outermost orders fade into the next ones.
    """
    samples = far.light.shape[axis]
    last = most + math.ceil(fade / 2)
    orders = np.arange(-last, last + 1)
    places = np.fft.fftfreq(samples) + orders[:, None]
    envelopes = np.stack([far.envelope(axis, int(order)) for order in orders])
    if fade:
        envelopes *= np.clip(0.5 + (most + 0.5 - np.abs(places)) / fade, 0, 1)
    cells = np.rint(places * cells_per_period).astype(np.intp) + half
    inside = (cells >= 0) & (cells <= 2 * half)
    sample = np.broadcast_to(np.arange(samples), cells.shape)
    entries = envelopes[inside].astype(np.float32), (cells[inside], sample[inside])
    return csr_array(entries, shape=(2 * half + 1, samples))


class LensProbe:
    """What a camera's lens and stop do to light of a wavelength in metres, which patterns share.

    nearest: the least distance of a point, metres; the stop's shadow on the panel is computed for
        its light.
    samples_per_spot: of far fields.
    """

    def __init__(
        self,
        camera: Camera,
        wavelength: float,
        nearest: float,
        cache: ByteCache,
        samples_per_spot: float = 2,
    ) -> None:
        self._camera, self._wavelength, self._nearest = camera, wavelength, nearest
        self._cache, self._samples_per_spot = cache, samples_per_spot

    @property
    def aperture_share(self) -> torch.Tensor:
        """Return the share of each panel pixel that the stop leaves open, (rows, columns)."""

        def compute() -> torch.Tensor:
            camera = self._camera
            spread = 1 + as_number(camera.separation) / self._nearest
            lens = replace(camera.lens, f_number=camera.lens.f_number * spread)
            return pupil_amplitude(replace(camera, lens=lens, separation=0.0))

        return self._from_cache(compute, "aperture")

    def lens_phase(self, distance: float) -> torch.Tensor:
        """Return the phase that the lens adds to a point's light on the panel, radians."""
        path = self._from_cache(lambda: self._path(distance), "path", distance)
        return 2 * math.pi / self._wavelength * path

    def field(self, distance: float) -> torch.Tensor:
        """Return uniform light's field on the panel behind lens and stop, complex64."""

        def compute() -> torch.Tensor:
            return torch.polar(self.aperture_share, self.lens_phase(distance)).to(torch.complex64)

        return self._from_cache(compute, "field", distance, self._wavelength)

    def unmodulated_far_field(self, distance: float) -> FarField:
        """Return the far field of light that the panel's pattern doesn't modulate."""
        side, samples = math.sqrt(self._camera.panel.fill_factor), self._samples_per_spot
        return self._from_cache(
            lambda: FarField(self.field(distance), side, samples), "far", distance, self._wavelength
        )

    def _from_cache(self, compute: Callable[[], T], *what: str | float) -> T:
        causes = self._camera, self._nearest, self._samples_per_spot, *what
        return self._cache.get(causes, compute)

    def _path(self, distance: float) -> torch.Tensor:
        """Return the optical path in metres that the lens adds to a point's light on the panel."""
        camera, lens = self._camera, self._camera.lens
        spread = 1 + as_number(camera.separation) / distance
        vergence = 1 / object_to_lens_distance(camera, distance) - 1 / lens.focus_distance
        y, x = camera.panel.plane.mesh()
        bent = spread * lens.image_distance / as_number(camera.ray_matrix_b) * vergence
        path = bent / 2 * (y**2 + x**2)
        radius = as_number(lens.stop_diameter) / 2 / spread
        for n, m, strength in lens.aberrations:
            path = path + as_number(strength) * zernike(n, m, y / radius, x / radius)
        return torch.where(self.aperture_share > 0, path, 0.0)
