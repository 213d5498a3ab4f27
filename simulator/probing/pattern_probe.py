"""A shown pattern or video, probed for bounds on its PSF before any PSF is computed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from optics.caching import ByteCache
from optics.camera import Camera, Panel
from optics.slm import Modulator
from optics.slm.panel import max_gap_power, max_phase
from optics.validation import as_number
from simulator.focus import defocused
from simulator.panel_at_wavelength import modulator_at
from simulator.panel_content import PanelContent
from simulator.probing.far_field import FarField, LensProbe, order_kernel, side_order_kernel
from simulator.probing.transfer_bounds import TransferBounds, largest_near, rings

Array = NDArray[np.float64]
_State = tuple[LensProbe, float]


_PICTURES = 4  # pictures of a video, evenly spaced, that are probed at most. Chosen.

# Share of the light by which the PSF of unmodulated light must be wider than those of the pattern
# to be included. Chosen.
_WIDER_SHARE = 1e-3


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


class _ShownPattern:
    """A pattern or video on a camera's panel at a wavelength in metres, without the lens."""

    def __init__(self, camera: Camera, panel_content: PanelContent, wavelength: float) -> None:
        self.camera, self.panel_content, self.wavelength = camera, panel_content, wavelength

    @property
    def panel(self) -> Panel:
        return self.camera.panel

    @cached_property
    def modulator(self) -> Modulator:
        return modulator_at(self.camera.panel, self.wavelength)

    @cached_property
    def greys(self) -> list[torch.Tensor]:
        """Return the different pictures on the panel, or some of many, (rows, columns) uint8."""
        pictures = self.panel_content.pictures
        names = sorted(pictures)[:: max(1, math.ceil(len(pictures) / _PICTURES))]
        return [torch.from_numpy(pictures[name].copy()) for name in names]

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


class PatternProbe(_ShownPattern):
    """A shown pattern and bounds on its PSF, behind a lens that images some distances.

    Far fields of the panel's light are computed with all effects of the panel, and with the lens'
    phase for the nearest and the farthest of the given distances. Each property is computed when it
    is first needed. Bounds of shares and densities hold for any picture, distance and focus, and
    for unmodulated light. Raises ValueError without any distance. Distances are in metres.
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
        super().__init__(camera, panel_content, wavelength)
        self.distances = tuple(sorted({min(distances), max(distances)}))
        cache = ByteCache() if cache is None else cache
        nearest = self.distances[0]

        def states(foci: tuple[float, ...]) -> list[_State]:
            cameras = [defocused(camera, one) for one in foci]
            lenses = [
                LensProbe(one, wavelength, nearest, cache, samples_per_spot) for one in cameras
            ]
            return [(lens, distance) for lens in lenses for distance in self.distances]

        self._states, self._leaked = states(foci), states(leaked_foci)
        self.samples_per_spot, self.foci, self.leaked_foci = samples_per_spot, foci, leaked_foci
        self._far_fields: dict[tuple[LensProbe, float, int], FarField] = {}
        self.results: dict[Hashable, Any] = {}
        """Results that effects have computed from this probe, by what else they depend on."""

    @property
    def aperture_share(self) -> torch.Tensor:
        """Return the share of each panel pixel that the stop leaves open, float64."""
        lens, _ = self._states[0]
        return lens.aperture_share

    @cached_property
    def min_relative_power(self) -> float:
        """Return the least power of a picture behind the panel, over that of even pixels."""
        if not self._ideal_fields:
            return 1.0
        weight = self.aperture_share.to(torch.float32).square()
        light = [((f.real.square() + f.imag.square()) * weight).sum() for f in self.fields]
        return float(min(light) / weight.sum()) if bool(weight.any()) else 0.0

    @cached_property
    def max_relative_power(self) -> float:
        """Bound the power of any picture behind the panel, over that of even pixels.

        Light of the gaps may be in phase with theirs, and a beam brighter where the stop is open.
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
        """Return the phase in radians that the lens adds on the panel, by distance and focus."""
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

    @property
    def _far_fields_by_state(self) -> Iterator[tuple[list[FarField], FarField]]:
        """Yield the far fields of the pictures and of unmodulated light, by distance and focus."""
        return zip(self._pattern_far_fields, self._unmodulated_far_fields, strict=True)

    @cached_property
    def _possible_far_fields(self) -> list[FarField]:
        """Return those with all effects of the panel, with none, and of unmodulated light."""
        states = [*self._states, *self._leaked]
        bare = [self._far(field, *state) for state in states for field in self._ideal_fields]
        leaked = [self._far(field, *state) for state in self._leaked for field in self.fields]
        straight = [lens.unmodulated_far_field(distance) for lens, distance in self._leaked]
        shown = itertools.chain(*self._pattern_far_fields)
        every = [*shown, *bare, *leaked, *self._unmodulated_far_fields, *straight]
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
        """Return side_order_kernel() of the pattern for each distance; cell and fade in metres."""
        return [
            side_order_kernel(there[0], self.period, cell, lowest, highest, fade)
            for there in self._pattern_far_fields
        ]

    def blur_kernels(self, cell: float, reach: float) -> list[Array]:
        """Return order_kernel() of a point's light for each distance; cell and reach in metres.

        It holds the mean over a video's pictures, unmodulated light, and the side orders up to the
        second that are within reach.
        """
        most = max(math.ceil(min(reach / self.period - 0.5, 2.0)), 0)
        held, share = 1 - self.modulator.jitter_scatter_share, self.modulator.unmodulated_share
        found = []
        for there, straight in self._far_fields_by_state:
            far = *there, straight
            every = [order_kernel(one, self.period, cell, most, reach=reach) for one in far]
            mean = sum(every[:-1]) / len(there)
            found.append(np.asarray((1 - share) * held * mean + share * every[-1]))
        return found

    @cached_property
    def _ensquared_share(self) -> Array:
        """Return the least share of the zeroth order's light in squares, as in FarField."""
        curve = np.min([one.ensquared_share for one in self._possible_far_fields], axis=0)
        # Jitter spreads its share evenly over the period.
        outside = 1 - np.linspace(0, 1, len(curve)) ** 2
        return np.asarray(np.minimum(curve, 1 - self.modulator.jitter_scatter_share * outside))

    def _index(self, half_side: float) -> int:
        """Return the index of the largest known square within a half side in metres."""
        steps = len(self._ensquared_share) - 1
        # The light of a sample may be anywhere within half a step.
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
        """Bound the integral of the squared zeroth-order PSF outside a square, 1/m²."""
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
        for there, straight in self._far_fields_by_state:
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
        """Bound how transfer functions of all fields differ in a focus from those in the first one.

        number: of the focus in `foci` and `leaked_foci`. See largest_near() for all else.
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
            for state, still in zip(states[first:], states[:count], strict=False):
                pairs = [(self._far(one, *state), self._far(one, *still)) for one in fields]
                (lens, distance), (same, _) = state, still
                straight = (
                    lens.unmodulated_far_field(distance),
                    same.unmodulated_far_field(distance),
                )
                pairs.append(straight)
                changes += [bins.most(_power(a.transfer - b.transfer)) for a, b in pairs]
            found.append(np.sqrt(np.max(changes, axis=0)))
        return found

    @property
    def _shape(self) -> tuple[int, int]:
        rows, columns = self._pattern_far_fields[0][0].light.shape
        return rows, columns

    def transfers_at(
        self, ky: Array, kx: Array, half: tuple[float, float]
    ) -> list[NDArray[np.complex128]]:
        """Return FarField.transfer_at() of every picture at each distance.

        There is one of unmodulated light as well, where its PSF is wider.
        """
        shown = [one for there in self._pattern_far_fields for one in there]
        least = np.min([one.ensquared_share for one in shown], axis=0) - _WIDER_SHARE
        far = [one for one in self._unmodulated_far_fields if (one.ensquared_share < least).any()]
        return [one.transfer_at(ky, kx, self.period, half) for one in (*shown, *far)]

    def transfers_behind_moved_stop(
        self, moves: Sequence[tuple[float, float]], ky: Array, kx: Array, half: tuple[float, float]
    ) -> list[list[NDArray[np.complex128]]]:
        """Return FarField.transfer_at() if the stop's shadow moves by (y, x) metres on the panel.

        There is one list for each distance, with one transfer function for each move, of the first
        picture.
        """
        side, pitch = math.sqrt(self.panel.fill_factor), self.panel.pitch

        def behind(lit: torch.Tensor, move: tuple[float, float]) -> NDArray[np.complex128]:
            field = _move_pixels(lit, move[0] / pitch, move[1] / pitch) * self.fields[0]
            far = FarField(field, side, self.samples_per_spot)
            return far.transfer_at(ky, kx, self.period, half)

        lit = [lens.field(distance) for lens, distance in self._states]
        return [[behind(one, move) for move in moves] for one in lit]


def _move_pixels(values: torch.Tensor, down: float, along: float) -> torch.Tensor:
    """Move values of the panel's pixels, interpolated linearly; 0 takes their place."""
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


def _power(transfer: NDArray[np.complex64]) -> NDArray[np.float32]:
    """Return the squared modulus of a transfer function."""
    return np.asarray(transfer.real**2 + transfer.imag**2)
