"""A shown pattern or video, probed for bounds on its PSF before any PSF is computed."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
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
from optics.slm.panel import max_gap_power, max_phase
from optics.validation import as_number
from simulator.focus import defocused
from simulator.panel_at_wavelength import modulator_at
from simulator.panel_content import PanelContent
from simulator.probing.far_field import FarField, LensProbe, order_kernel, side_order_kernel
from simulator.probing.transfer_bounds import TransferBounds, largest_near, rings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PatternProbeSettings:
    """Tune how a shown pattern is probed. All values are chosen.

    max_pictures: of a video, that are probed at most, evenly spaced.
    transfer_error: of a transfer function between the samples of its grid, as a share of all light.
    wider_share: of the light, by which the PSF of unmodulated light must be wider than those of the
        pattern to be included.
    lines: of the panel along each axis, from which the mean angle of the rays is computed.
    alias_free: cycles per sample from which on the transfer function of light with fewer than two
        samples a diffraction spot fades out.
    """

    max_pictures: int = 4
    transfer_error: float = 1e-6
    wider_share: float = 1e-3
    lines: int = 128
    alias_free: float = 0.35


_SETTINGS = PatternProbeSettings()


def panel_without_effects(panel: Panel) -> Panel:
    """Return the panel without any of the simulator's effects."""
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
    """A pattern or video on a camera's panel at a wavelength, and bounds on its PSF.

    Far fields of the panel's light are computed with all effects of the panel, and with the lens'
    phase for the nearest and the farthest of the given distances. Each property is computed when it
    is first needed. Bounds of shares and densities hold for any picture, distance and focus, and
    for unmodulated light. Raises ValueError without any distance.
    wavelength, distances: metres.
    cache: stores what lens and stop do, for other patterns.
    samples_per_spot: of far fields; fewer than 2 suffice for estimates.
    foci, leaked_foci: metres behind the sensor at which the lens may form its image of the band's
        light and of light that leaks; all light is probed in each of them.
    """

    def __init__(
        self,
        camera: Camera,
        panel_content: PanelContent,
        wavelength: float,
        distances: tuple[float, ...],
        cache: ByteCache | None = None,
        *,
        samples_per_spot: float = 2,
        foci: tuple[float, ...] = (0.0,),
        leaked_foci: tuple[float, ...] = (),
    ) -> None:
        if not distances:
            raise ValueError("distances is empty; give that of one layer at least")
        self.camera, self.panel_content, self.wavelength = camera, panel_content, wavelength
        self.distances = tuple(sorted({min(distances), max(distances)}))
        cache = ByteCache() if cache is None else cache
        lenses, leaked = (
            [LensProbe(defocused(camera, one), wavelength, self.distances[0], cache,
                       samples_per_spot) for one in some]
            for some in (foci, leaked_foci)
        )  # fmt: skip
        self._lens = lenses[0]
        self._states = [(lens, distance) for lens in lenses for distance in self.distances]
        self._leaked = [(lens, distance) for lens in leaked for distance in self.distances]
        self.samples_per_spot, self.foci, self.leaked_foci = samples_per_spot, foci, leaked_foci
        self._far_fields: dict[tuple[LensProbe, float, int], FarField] = {}
        self.results: dict[Hashable, Any] = {}
        """Results that effects have computed from this probe, by what else they depend on."""

    @property
    def panel(self) -> Panel:
        return self.camera.panel

    @cached_property
    def modulator(self) -> Modulator:
        return modulator_at(self.camera.panel, self.wavelength)

    @cached_property
    def greys(self) -> list[torch.Tensor]:
        """Return the different pictures on the panel, or some of many, (rows, columns) uint8."""
        names = sorted(self.panel_content.pictures)
        step = max(1, math.ceil(len(names) / _SETTINGS.max_pictures))
        return [
            torch.from_numpy(self.panel_content.pictures[name].copy()) for name in names[::step]
        ]

    @cached_property
    def phases(self) -> list[torch.Tensor]:
        """Return the settled panel phase of each picture, radians, float64."""
        return [torch.as_tensor(self.modulator.phase(grey)) for grey in self.greys]

    @cached_property
    def linear_phase_range(self) -> float:
        """Return the phase of the panel's highest grey level if its response is linear, radians."""
        return max_phase(self.modulator.panel, self.wavelength)

    @cached_property
    def fields(self) -> list[torch.Tensor]:
        """Return the field behind the panel for each picture, complex64."""
        return [self.modulator.modulation_of_grey(grey) for grey in self.greys]

    @cached_property
    def _ideal_fields(self) -> list[torch.Tensor]:
        """Return each picture's field behind an ideal panel; none if the panel itself is ideal."""
        bare = replace(panel_without_effects(self.panel), unmodulated=self.panel.unmodulated)
        if bare == self.panel:
            return []
        modulator = modulator_at(bare, self.wavelength)
        return [modulator.modulation_of_grey(grey) for grey in self.greys]

    @property
    def aperture_share(self) -> torch.Tensor:
        """Return the share of each panel pixel that the stop leaves open, float64."""
        return self._lens.aperture_share

    @cached_property
    def min_relative_power(self) -> float:
        """Return the least power of a picture behind the panel, over uniform pixels' power.

        The pixels for comparison have an amplitude of 1. A phase that is blurred within pixels
        makes the power less.
        """
        if not self._ideal_fields:
            return 1.0
        weight = self.aperture_share.to(torch.float32).square()
        light = [((f.real.square() + f.imag.square()) * weight).sum() for f in self.fields]
        return float(min(light) / weight.sum()) if bool(weight.any()) else 0.0

    @cached_property
    def max_relative_power(self) -> float:
        """Bound the power of any picture behind the panel, over uniform pixels' power.

        The light of the gaps between pixels may be in phase with that of the pixels. An uneven beam
        may be brighter than its mean where the stop is open.
        """
        power, panel = max_gap_power(self.panel), self.panel
        weight = self.aperture_share.square()
        if panel.illumination is None or not bool(weight.any()):
            return power
        beam = panel.illumination.at_pixels(panel)
        in_the_stop = float((beam * weight).sum() / weight.sum() / beam.mean())
        return power * max(1.0, in_the_stop)

    @property
    def period(self) -> float:
        """Return the metres on the sensor between the panel's diffraction orders."""
        return self.wavelength * as_number(self.camera.ray_matrix_b) / self.panel.pitch

    @property
    def lens_phases(self) -> list[torch.Tensor]:
        """Return the phase that the lens adds to a point's light on the panel, radians.

        There is one for each distance and focus.
        """
        return [lens.lens_phase(distance) for lens, distance in self._states]

    def _far(self, field: torch.Tensor, lens: LensProbe, distance: float) -> FarField:
        """Return the far field of a field behind the panel, with the lens' phase."""
        # A neutral pattern has the far field of unmodulated light.
        if bool((field == field[0, 0]).all()):
            return lens.unmodulated_far_field(distance)
        known = lens, distance, id(field)
        if known not in self._far_fields:
            side = math.sqrt(self.panel.fill_factor)
            found = FarField(lens.field(distance) * field, side, self.samples_per_spot)
            self._far_fields[known] = found
        return self._far_fields[known]

    @cached_property
    def _pattern_far_fields(self) -> list[list[FarField]]:
        """Return the far fields of every picture, for each distance and focus."""
        return [[self._far(field, *state) for field in self.fields] for state in self._states]

    @cached_property
    def _unmodulated_far_fields(self) -> list[FarField]:
        """Return the far field of unmodulated light for each distance and focus."""
        return [lens.unmodulated_far_field(distance) for lens, distance in self._states]

    @cached_property
    def _possible_far_fields(self) -> list[FarField]:
        """Return the far fields of all light that may reach the sensor.

        These are the far fields with all effects of the panel, with none of them, and of
        unmodulated light.
        """
        states = [*self._states, *self._leaked]
        bare = [self._far(field, *state) for state in states for field in self._ideal_fields]
        leaked = [self._far(field, *state) for state in self._leaked for field in self.fields]
        every = [
            *(one for there in self._pattern_far_fields for one in there),
            *bare,
            *leaked,
            *self._unmodulated_far_fields,
            *(lens.unmodulated_far_field(distance) for lens, distance in self._leaked),
        ]
        return list(dict.fromkeys(every))

    @cached_property
    def side_order_share(self) -> float:
        """Bound the share of the light outside the zeroth diffraction order."""
        return self.beyond_orders(0)

    @cached_property
    def zeroth_order_share(self) -> float:
        """Bound the share of the light in the zeroth diffraction order."""
        return max(one.order_share(0) for one in self._possible_far_fields)

    def beyond_orders(self, most: int) -> float:
        """Bound the share of the light in orders beyond `most` on each side."""
        return max(0.0, 1 - min(one.order_share(most) for one in self._possible_far_fields))

    def side_order_kernels(
        self, cell: float, lowest: int, highest: int, fade: float
    ) -> list[Array]:
        """Return how the pattern spreads light over side orders, for each distance.

        See side_order_kernel().
        cell: side of a cell, metres.
        fade: metres.
        """
        return [
            side_order_kernel(there[0], self.period, cell, lowest, highest, fade)
            for there in self._pattern_far_fields
        ]

    def blur_kernels(self, cell: float, reach: float) -> list[Array]:
        """Return how the pattern spreads all of a point's light, for each distance.

        See order_kernel(). The mean over a video's pictures counts, with unmodulated light and the
        side orders up to the second that come so far.
        cell: side of a cell, metres.
        reach: how far the light matters, metres.
        """
        most = max(math.ceil(min(reach / self.period - 0.5, 2.0)), 0)
        held, share = 1 - self.modulator.jitter_scatter_share, self.modulator.unmodulated_share
        found = []
        for there, straight in zip(
            self._pattern_far_fields, self._unmodulated_far_fields, strict=True
        ):
            every = [
                order_kernel(one, self.period, cell, most, reach=reach)
                for one in (*there, straight)
            ]
            mean = sum(every[:-1]) / len(there)
            found.append(np.asarray((1 - share) * held * mean + share * every[-1]))
        return found

    @cached_property
    def mean_ray_displacement(self) -> float:
        """Return the mean distance on the sensor from a point's image to its rays, metres.

        It is the largest of all pictures, unmodulated light and object distances, computed along
        some lines of the panel.
        """
        worst = 0.0
        straight = torch.ones(self.panel.shape, dtype=torch.complex64)
        waves = self.lens_phases
        for field in (*self.fields, straight):
            for wave in waves:
                turns = [self._mean_step(field, wave, axis) for axis in (0, 1)]
                worst = max(worst, math.hypot(*turns) * 1.5)
        lever = as_number(self.camera.ray_matrix_b) * self.wavelength
        return worst / (2 * math.pi * self.panel.pitch) * lever

    def _mean_step(self, field: torch.Tensor, wave: torch.Tensor, axis: int) -> float:
        """Return the mean phase step between neighbouring pixels along an axis, radians."""
        every = max(1, field.shape[1 - axis] // _SETTINGS.lines)
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
        """Return the least share of the zeroth order's light in squares, as in FarField."""
        curve = np.min([one.ensquared_share for one in self._possible_far_fields], axis=0)
        half = np.linspace(0, 1, len(curve))
        # Jitter spreads its share evenly over the period.
        return np.asarray(
            np.minimum(curve, 1 - self.modulator.jitter_scatter_share * (1 - half**2))
        )

    def _index(self, half_side: float) -> int:
        """Return the index of the largest known square within a half side in metres.

        Half a step is subtracted, because the light of a sample may be anywhere within it.
        """
        steps = len(self._ensquared_share) - 1
        return math.floor(half_side / (self.period / 2) * steps - 0.5)

    def share_beyond(self, half_side: float) -> float:
        """Bound the share of the zeroth order's light outside a square of a half side in metres."""
        index = self._index(half_side)
        if index >= len(self._ensquared_share) - 2:
            return 0.0
        return 1.0 if index < 0 else float(max(0.0, 1 - self._ensquared_share[index]))

    def reach_of_share(self, share: float) -> float:
        """Return the half side in metres of a square that misses at most `share` of the light."""
        if not 0 < share <= 1:
            raise ValueError(f"share is {share:g}; give one above 0, up to 1")
        steps = len(self._ensquared_share) - 1
        enough = np.flatnonzero(1 - self._ensquared_share <= share)
        index = int(enough[0]) if len(enough) else steps
        return min((index + 1.5) / steps, 1.0) * self.period / 2

    @cached_property
    def peak(self) -> float:
        """Bound the PSF's peak as a share of the light per square metre of the sensor."""
        return max(one.peak for one in self._possible_far_fields) / self.period**2

    @cached_property
    def squared_density(self) -> float:
        """Bound the integral of the squared PSF over the sensor, 1/m²."""
        return max(one.energy for one in self._possible_far_fields) / self.period**2

    def squared_density_beyond(self, half_side: float) -> float:
        """Bound the integral of the squared zeroth-order PSF outside a square of a half side, 1/m².

        half_side: metres.
        """
        index = self._index(half_side)
        if index < 0:
            return self.squared_density
        curves = [one.beyond_energy for one in self._possible_far_fields]
        even = self.modulator.jitter_scatter_share
        found = max(float(one[min(index, len(one) - 1)]) for one in curves)
        return (math.sqrt(found) + even) ** 2 / self.period**2

    @cached_property
    def transfer_bounds(self) -> TransferBounds:
        """Bound the PSF's transfer function, for all pictures, distances and foci."""
        bins = rings(self._shape)
        held, share = 1 - self.modulator.jitter_scatter_share, self.modulator.unmodulated_share
        mixed = []
        for there, straight in zip(
            self._pattern_far_fields, self._unmodulated_far_fields, strict=True
        ):
            # The transfer function of a video is the mean of those of its pictures.
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
            np.max([mean for mean, _ in mixed], axis=0),
            np.sqrt(np.min([least for _, least in mixed], axis=0)),
            np.sqrt(most),
            np.maximum.accumulate(np.sqrt(lost)),
        )

    def focus_change(self, number: int, frequency: Array, spread: float) -> Array:
        """Bound how transfer functions in a focus differ from those in the first one.

        The change is the largest of all fields, near frequencies in cycles per metre; see
        largest_near().
        number: of the focus in `foci` and `leaked_foci`.
        """
        edges = rings(self._shape).edges / self.period
        return largest_near(edges[:-1], edges[1:], self._focus_changes[number], frequency, spread)

    @cached_property
    def _focus_changes(self) -> list[Array]:
        """Return the largest changes of transfer functions by focus, in radial bins."""
        fields, bins = [*self._ideal_fields, *self.fields], rings(self._shape)
        count, found = len(self.distances), list[Array]()
        states = [*self._states, *self._leaked]
        for first in range(0, len(states), count):
            changes = []
            for (lens, distance), (same, _) in zip(states[first:], states[:count], strict=False):
                pairs = [
                    (self._far(one, lens, distance), self._far(one, same, distance))
                    for one in fields
                ]
                straight = (
                    lens.unmodulated_far_field(distance),
                    same.unmodulated_far_field(distance),
                )
                changes += [
                    bins.most(_power(a.transfer - b.transfer)) for a, b in (*pairs, straight)
                ]
            found.append(np.sqrt(np.max(changes, axis=0)))
        return found

    @property
    def _shape(self) -> tuple[int, int]:
        rows, columns = self._pattern_far_fields[0][0].light.shape
        return rows, columns

    def transfers_at(
        self, ky: Array, kx: Array, half: tuple[float, float]
    ) -> list[NDArray[np.complex128]]:
        """Return the zeroth order's transfer functions at frequencies (ky, kx), cycles/m.

        There is one for every picture at each distance, and one for unmodulated light where its PSF
        is wider. The values are 0 at frequencies that the panel doesn't resolve.
        half: half sides (y, x) in metres of the part of the PSF that is transformed, up to two side
            orders.
        """
        shown = [one for there in self._pattern_far_fields for one in there]
        least = np.min([one.ensquared_share for one in shown], axis=0) - _SETTINGS.wider_share
        far = [one for one in self._unmodulated_far_fields if (one.ensquared_share < least).any()]
        return [self._transfer_at(one, ky, kx, half) for one in (*shown, *far)]

    def _transfer_at(
        self, far: FarField, ky: Array, kx: Array, half: tuple[float, float]
    ) -> NDArray[np.complex128]:
        """Return the transfer function of a far field's light; see transfers_at().

        A large panel's side orders are left out of estimates: they are far aside.
        """
        reached = math.ceil(min(max(half) / self.period - 0.5, 2.0))
        most = max(reached, 0) if self.samples_per_spot == 2 else 0
        pitch = self.period / far.light.shape[0], self.period / far.light.shape[1]
        y, x = (
            math.ceil(min(aside / step + 1, (2 * most + 1) * n // 2))
            for aside, step, n in zip(half, pitch, far.light.shape, strict=True)
        )
        light = far.light_around_axis((y, x))
        return _transfer_at(light, pitch, ky, kx, self.samples_per_spot)

    def transfers_behind_moved_stop(
        self, moves: Sequence[tuple[float, float]], ky: Array, kx: Array, half: tuple[float, float]
    ) -> list[list[NDArray[np.complex128]]]:
        """Return the transfer functions if the shadow of the stop moves over the panel.

        There is one list for each distance, with one transfer function for each move, of the first
        picture. The frequencies are as in transfers_at().
        moves: (y, x) metres on the panel.
        """
        found, side = [], math.sqrt(self.panel.fill_factor)
        for state, distance in self._states:
            lens, transfers = state.field(distance), []
            for move in moves:
                away = move[0] / self.panel.pitch, move[1] / self.panel.pitch
                field = _move_pixels(lens, *away) * self.fields[0]
                far = FarField(field, side, self.samples_per_spot)
                transfers.append(self._transfer_at(far, ky, kx, half))
            found.append(transfers)
        return found


def _move_pixels(values: torch.Tensor, down: float, along: float) -> torch.Tensor:
    """Move values of the panel's pixels by pixels; 0 takes their place.

    Between whole pixels, values are interpolated linearly.
    """
    for axis, away in ((0, down), (1, along)):
        whole = math.floor(away)
        near, far = (_move_by_whole_pixels(values, axis, one) for one in (whole, whole + 1))
        values = torch.lerp(near, far, away - whole)
    return values


def _move_by_whole_pixels(values: torch.Tensor, axis: int, away: int) -> torch.Tensor:
    n = values.shape[axis]
    moved = torch.zeros_like(values)
    if abs(away) < n:
        kept = values.narrow(axis, max(-away, 0), n - abs(away))
        moved.narrow(axis, max(away, 0), n - abs(away)).copy_(kept)
    return moved


def _transfer_at(
    light: NDArray[np.float32],
    pitch: tuple[float, float],
    ky: Array,
    kx: Array,
    samples_per_spot: float,
) -> NDArray[np.complex128]:
    """Return the transfer function of a far field's light at frequencies (ky, kx), cycles/m.

    It fades out where light with fewer than two samples a spot doesn't tell it.
    light: with the optical axis in the middle.
    pitch: metres on the sensor between its samples.
    """
    known = (abs(ky) * pitch[0] < 0.5) & (abs(kx) * pitch[1] < 0.5)
    found = np.zeros(known.shape, dtype=np.complex128)
    series = NonuniformTransform(
        torch.from_numpy(ky[known]), torch.from_numpy(kx[known]), Plane(light.shape, pitch), 1.0,
        _SETTINGS.transfer_error, few_points=True,
    )  # fmt: skip
    found[known] = series.adjoint(torch.from_numpy(light)).numpy()
    if samples_per_spot < 2:
        for k, step in ((ky, pitch[0]), (kx, pitch[1])):
            ramp = np.clip((0.5 - abs(k) * step) / (0.5 - _SETTINGS.alias_free), 0, 1)
            found *= np.sin(np.pi / 2 * ramp) ** 2
    return found


def _power(transfer: NDArray[np.complex64]) -> NDArray[np.float32]:
    """Return the squared modulus of a transfer function."""
    return np.asarray(transfer.real**2 + transfer.imag**2)
