"""What is known of the PSF of what is shown, before any is computed."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from optics.caching import ByteCache
from optics.camera import Camera, Panel
from optics.fourier import NonuniformTransform
from optics.plane import Plane
from optics.slm import Modulator
from optics.slm.phase_range import max_phase
from optics.validation import as_number
from simulator.panel_at_wavelength import modulator_at
from simulator.panel_content import PanelContent
from simulator.probing.far_field import FarField
from simulator.probing.lens_probe import LensProbe
from simulator.probing.transfer_bounds import TransferBounds, rings

Array = NDArray[np.float64]

_MOST_PICTURES = 4
"""Of a video, that are looked at: evenly among them."""

_SERIES = 1e-6
"""Error of transfer functions between the samples of their grid, of all light."""

_AS_FAR = 1e-3
"""Share of the light by which one PSF is wider than another, to count besides it."""

_LINES = 128
"""Lines of a panel along each axis by which the turns of its rays are told."""


def panel_without_effects(panel: Panel) -> Panel:
    """The panel without any of its effects."""
    return replace(
        panel,
        response=None,
        response_time=0.0,
        coupling=0.0,
        flicker=0.0,
        jitter=0.0,
        front_reflection=0.0,
        gap_reflection=0.0,
        flatness=None,
        illumination=None,
        unmodulated=0.0,
    )


class PatternProbe:
    """A shown pattern, or video, behind a camera's panel at a wavelength; metres.

    The far field of what leaves the panel, with everything that the panel does to it, and with
    the lens' wave for the nearest and the farthest of some distances. Each property is computed
    when it is first asked for. cache: where what lens and stop do is kept for other patterns.
    """

    def __init__(
        self,
        camera: Camera,
        panel_content: PanelContent,
        wavelength: float,
        distances: tuple[float, ...],
        cache: ByteCache | None = None,
    ) -> None:
        if not distances:
            raise ValueError("distances is empty; give that of one layer at least")
        self.camera, self.panel_content, self.wavelength = camera, panel_content, wavelength
        self.distances = tuple(sorted({min(distances), max(distances)}))
        cache = ByteCache() if cache is None else cache
        self._lens = LensProbe(camera, wavelength, self.distances[0], cache)
        self.results: dict[Hashable, Any] = {}
        """What somebody has found out by it, by its other causes."""

    @property
    def panel(self) -> Panel:
        return self.camera.panel

    @cached_property
    def modulator(self) -> Modulator:
        return modulator_at(self.camera.panel, self.wavelength)

    @cached_property
    def greys(self) -> list[torch.Tensor]:
        """Different pictures that are shown, (rows, columns) uint8; of many, some."""
        names = sorted(self.panel_content.pictures)
        step = max(1, math.ceil(len(names) / _MOST_PICTURES))
        return [
            torch.from_numpy(self.panel_content.pictures[name].copy()) for name in names[::step]
        ]

    @cached_property
    def phases(self) -> list[torch.Tensor]:
        """Radians of each picture, settled, float64."""
        return [torch.as_tensor(self.modulator.phase(grey)) for grey in self.greys]

    @cached_property
    def linear_phase_range(self) -> float:
        """Radians at the highest level, if the phase grew evenly with it."""
        return max_phase(self.modulator.panel, self.wavelength)

    @cached_property
    def fields(self) -> list[torch.Tensor]:
        """What leaves the panel for each picture, complex64."""
        return [self.modulator.modulation(one.to(torch.float32)) for one in self.phases]

    @cached_property
    def _ideal_fields(self) -> list[torch.Tensor]:
        """The same of an ideal panel, where that is another one."""
        bare = replace(panel_without_effects(self.panel), unmodulated=self.panel.unmodulated)
        if bare == self.panel:
            return []
        modulator = modulator_at(bare, self.wavelength)
        phases = [torch.as_tensor(modulator.phase(grey)) for grey in self.greys]
        return [modulator.modulation(one.to(torch.float32)) for one in phases]

    @property
    def aperture_share(self) -> torch.Tensor:
        """Share of each pixel that the stop, or its shadow from the middle distance, leaves open,
        (rows, columns) float64."""
        return self._lens.aperture_share

    @cached_property
    def min_relative_power(self) -> float:
        """Light that leaves the open pixels of the dimmest picture, over that of even ones of
        amplitude 1: a phase that is blurred within pixels sends less."""
        weight = self.aperture_share.to(torch.float32).square()
        light = [((f.real.square() + f.imag.square()) * weight).sum() for f in self.fields]
        return float(min(light) / weight.sum()) if bool(weight.any()) else 0.0

    @property
    def period(self) -> float:
        """Metres on the sensor from one order of the panel's pixels to the next."""
        return self.wavelength * as_number(self.camera.ray_matrix_b) / self.panel.pitch

    def lens_phase(self, distance: float) -> torch.Tensor:
        """Radians that the lens leaves on the panel's light of a point, (rows, columns)."""
        return self._lens.lens_phase(distance)

    def _far(self, field: torch.Tensor, distance: float) -> FarField:
        # A neutral picture's light goes the way of light that ignores pictures.
        if bool((field == field[0, 0]).all()):
            return self._lens.unmodulated_far_field(distance)
        return FarField(self._lens.field(distance) * field, math.sqrt(self.panel.fill_factor))

    @cached_property
    def _pattern_far_fields(self) -> list[list[FarField]]:
        """Of every picture, at each distance."""
        return [[self._far(field, d) for field in self.fields] for d in self.distances]

    @cached_property
    def _unmodulated_far_fields(self) -> list[FarField]:
        """Of light that ignores the picture, at each distance."""
        return [self._lens.unmodulated_far_field(d) for d in self.distances]

    @cached_property
    def _possible_far_fields(self) -> list[FarField]:
        """Of whatever may fall on the sensor: with all of the panel's effects, with none of them,
        and what ignores the picture."""
        fields, distances = self._ideal_fields, self.distances
        bare = [self._far(field, d) for d in distances for field in fields]
        every = [
            *(one for there in self._pattern_far_fields for one in there),
            *bare,
            *self._unmodulated_far_fields,
        ]
        return list(dict.fromkeys(every))

    @cached_property
    def side_order_share(self) -> float:
        """Share of the light that the panel's pixels send beside the middle order, at most."""
        return self.beyond_orders(0)

    @cached_property
    def zeroth_order_share(self) -> float:
        """Share of the light in the middle order, at most."""
        return max(one.order_share(0) for one in self._possible_far_fields)

    def beyond_orders(self, most: int) -> float:
        """Share of the light in orders beyond the first `most` on each side, at most."""
        return max(0.0, 1 - min(one.order_share(most) for one in self._possible_far_fields))

    @cached_property
    def mean_ray_displacement(self) -> float:
        """Metres from a point's image to where a ray lands, in the mean: of any picture or light
        that ignores it, at any distance. Looked at along some lines of the panel."""
        worst = 0.0
        straight = torch.ones(self.panel.shape, dtype=torch.complex64)
        waves = [self.lens_phase(distance) for distance in self.distances]
        for field in (*self.fields, straight):
            for wave in waves:
                turns = [self._mean_step(field, wave, axis) for axis in (0, 1)]
                worst = max(worst, math.hypot(*turns) * 1.5)
        lever = as_number(self.camera.ray_matrix_b) * self.wavelength
        return worst / (2 * math.pi * self.panel.pitch) * lever

    def _mean_step(self, field: torch.Tensor, wave: torch.Tensor, axis: int) -> float:
        """Radians from one pixel to the next along an axis."""
        every = max(1, field.shape[1 - axis] // _LINES)
        field, wave, opened = (
            one[:, ::every] if axis == 0 else one[::every]
            for one in (field, wave, self.aperture_share)
        )
        n = field.shape[axis] - 1
        step = torch.angle(field.narrow(axis, 1, n) * field.narrow(axis, 0, n).conj())
        both = opened.narrow(axis, 1, n) * opened.narrow(axis, 0, n)
        turn = (step.double() + wave.diff(dim=axis)).abs()
        return float((turn * both).sum() / both.sum().clamp(min=1e-9))

    @cached_property
    def _ensquared_share(self) -> Array:
        """Least share of the middle order's light within squares around the axis: see FarField."""
        curve = np.min([one.ensquared_share for one in self._possible_far_fields], axis=0)
        half = np.linspace(0, 1, len(curve))
        # Jitter spreads its share evenly over the period.
        return np.asarray(
            np.minimum(curve, 1 - self.modulator.jitter_scatter_share * (1 - half**2))
        )

    def _index(self, half_side: float) -> int:
        """Of the largest square that surely is no larger: a sample's light may lie anywhere
        within it."""
        steps = len(self._ensquared_share) - 1
        return math.floor(half_side / (self.period / 2) * steps - 0.5)

    def share_beyond(self, half_side: float) -> float:
        """Share of the middle order's light beyond a square of so many metres to each side, at
        most: of any picture, at any distance, or of light that ignores the pattern."""
        index = self._index(half_side)
        if index >= len(self._ensquared_share) - 2:
            return 0.0
        return 1.0 if index < 0 else float(max(0.0, 1 - self._ensquared_share[index]))

    def reach_of_share(self, share: float) -> float:
        """Metres from a point's image beyond which less than a share of its light falls."""
        if not 0 < share <= 1:
            raise ValueError(f"share is {share:g}; give one above 0, up to 1")
        steps = len(self._ensquared_share) - 1
        enough = np.flatnonzero(1 - self._ensquared_share <= share)
        index = int(enough[0]) if len(enough) else steps
        return min((index + 1.5) / steps, 1.0) * self.period / 2

    @cached_property
    def peak(self) -> float:
        """Largest share of the light that a square metre of the sensor gets, of any picture at
        any distance, or of light that ignores the pattern."""
        return max(one.peak for one in self._possible_far_fields) / self.period**2

    @cached_property
    def squared_density(self) -> float:
        """Integral over the sensor of the squared density of a point's light, 1/m², at most."""
        return max(one.energy for one in self._possible_far_fields) / self.period**2

    def squared_density_beyond(self, half_side: float) -> float:
        """The same of the middle order's light beyond a square of so many metres to each side."""
        index = self._index(half_side)
        if index < 0:
            return self.squared_density
        curves = [one.beyond_energy for one in self._possible_far_fields]
        even = self.modulator.jitter_scatter_share
        found = max(float(one[min(index, len(one) - 1)]) for one in curves)
        return (math.sqrt(found) + even) ** 2 / self.period**2

    @cached_property
    def transfer_bounds(self) -> TransferBounds:
        """Of all pictures and distances."""
        shape = (2 * self.panel.shape[0], 2 * self.panel.shape[1])
        bins = rings(shape)
        held, share = 1 - self.modulator.jitter_scatter_share, self.modulator.unmodulated_share
        mixed = []
        for there, straight in zip(
            self._pattern_far_fields, self._unmodulated_far_fields, strict=True
        ):
            # Of a video, the mean.
            mean = sum(one.transfer for one in there) / len(there)
            power = _power((1 - share) * held * mean + share * straight.transfer)
            mixed.append((bins.mean(power), bins.least(power)))
        possible = [one.transfer for one in self._possible_far_fields]
        most = np.max([bins.most(_power(one)) for one in possible], axis=0)
        lost = np.max([bins.most(_power(1 - one)) for one in possible], axis=0)
        edges = bins.edges / self.period
        return TransferBounds(
            edges[:-1],
            edges[1:],
            np.min([mean for mean, _ in mixed], axis=0),
            np.sqrt(np.min([least for _, least in mixed], axis=0)),
            np.sqrt(most),
            np.maximum.accumulate(np.sqrt(lost)),
        )

    def transfers_at(
        self, ky: Array, kx: Array, half: tuple[float, float]
    ) -> list[NDArray[np.complex128]]:
        """The same at any frequencies, cycles per metre, of the middle order's light up to so
        many metres from the axis: of every picture at each distance, and of light that ignores
        them where it is spread as far as theirs. 0 beyond what the panel resolves."""
        shown = [one for there in self._pattern_far_fields for one in there]
        least = np.min([one.ensquared_share for one in shown], axis=0) - _AS_FAR
        far = [one for one in self._unmodulated_far_fields if (one.ensquared_share < least).any()]
        return [
            _transfer_at(one.zeroth_order_light, self.period, ky, kx, half)
            for one in (*shown, *far)
        ]


def _transfer_at(
    light: NDArray[np.float32], period: float, ky: Array, kx: Array, half: tuple[float, float]
) -> NDArray[np.complex128]:
    pitch = period / light.shape[0], period / light.shape[1]
    kept = [
        math.ceil(min(far / step + 1, n // 2))
        for far, step, n in zip(half, pitch, light.shape, strict=True)
    ]
    cut = np.fft.fftshift(light)
    y, x = (n // 2 for n in light.shape)
    cut = cut[y - kept[0] : y + kept[0], x - kept[1] : x + kept[1]]
    known = (abs(ky) * pitch[0] < 0.5) & (abs(kx) * pitch[1] < 0.5)
    found = np.zeros(known.shape, dtype=np.complex128)
    series = NonuniformTransform(
        torch.from_numpy(ky[known]), torch.from_numpy(kx[known]), Plane(cut.shape, pitch), 1.0,
        _SERIES, few_points=True,
    )  # fmt: skip
    found[known] = series.adjoint(torch.from_numpy(cut)).numpy()
    return found


def _power(transfer: NDArray[np.complex64]) -> NDArray[np.float32]:
    return np.asarray(transfer.real**2 + transfer.imag**2)
