"""How much light a stop's edge scatters into a window: what a cheaper method may leave out.

Seen from far away, an edge of length l under the irradiance I and a plane wave scatters the
spectral density I l / (4 pi² D²) per cycle along its normal, at the normal distance D in
frequency (the Fourier integral of a half plane; Keller's edge rays, 10.1364/JOSA.52.000116).
Light of all frequencies that the panel's pixels send, and that gets to a piece of the edge at
all, is so scattered into the few that the window receives. What a method does wrong with it is
summed over the edge, the window and D, and compared with the light that goes straight into the
window. Nearer than D = 1 / (4 radius) the two sides of a stop aren't told apart: all of it, of
the area S, sends S² to a unit of frequency area at the most, which is 2 pi D S² per cycle,
shared out among the pieces of the edge. Of a round stop's light, both parts together are 1.02.

No pattern is known beforehand: the panel counts as evenly lit at all of its frequencies, under
the envelope sinc² of one pixel, as behind a random pattern. There the relative error of the
intensity is that of the field; less where it is integrated over pixels, since what comes from
the edge beats finely with what comes from elsewhere in the stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera
from optics.chain.propagator_axes import stop_extent
from optics.fourier import unit_phasor
from optics.point.request import PSFRequest
from optics.pupil import open_area, pupil_phase

Array = NDArray[np.float64]

_EDGE_PIECES, _FAR_STEPS, _NEAR_STEPS, _STOP_SAMPLES = 96, 48, 6, 40
"""Pieces of the stop's edge, distances in frequency to either side, those at which the edges are
not told apart, and places across the stop."""

_MAX_CYCLES_PER_PIXEL = 40.0
"""Cycles per pixel beyond which its envelope leaves no light that counts."""

_MANY_SPECKLES_FACTOR, _FEW_SPECKLES_FACTOR = 0.95, 2.5
"""What an estimate for an evenly lit panel is multiplied by: for many speckles in the window,
where it was measured to be too large by a quarter to a half, since rays light the ends of the
panel's shadow fully; and for a single one, as the square root of their number falls."""

_MIN_RELATIVE_LIGHT = 0.02
"""Of the brightest light, what counts as light at all."""

_WINDOW_PROBE_OFFSET = 1 / 3
"""Of a window's sides from its middle: where it is looked at, to stand for all of it."""


@dataclass(frozen=True)
class RaySamples:
    """Light at places in the lens' plane, (..., 2) for y and x.

    frequency: cycles per metre at the panel. panel_position: metres on the panel that it comes
    from. light: its density, 0 where the panel sends none. unbounded_light: what it would be if the
    panel had no end, so that it wouldn't matter where the light comes from.
    """

    frequency: Array
    panel_position: Array
    light: Array
    unbounded_light: Array


class StopEdgeScatter:
    """The edge of a camera's stop, and what goes from the panel by way of it into a window."""

    def __init__(self, request: PSFRequest, camera: Camera) -> None:
        self._q, self._camera = request.numeric, camera
        q = self._q
        self._shadow_magnification = q.shadow_magnification
        self._shift = np.array([sine * q.separation for sine in q.chief_ray_slopes])
        self._fresnel_area = q.wavelength * camera.separation / self._shadow_magnification
        self._edge_points, self._normal, self._length = _sample_stop_edge(camera, q.radius)
        low = 1 / (4 * q.radius)
        edges = _normal_distance_steps(
            low, _MAX_CYCLES_PER_PIXEL / camera.panel.active_side, len(self._length)
        )
        away, step = (edges[:, 1:] + edges[:, :-1]) / 2, np.diff(edges)
        area, rim = q.lens.stop.area * q.radius**2, self._length.sum()
        whole = math.pi * away * area**2 / rim
        each = np.where(away < low, whole, 1 / (4 * math.pi**2 * away**2)) * step
        self._normal_distances = np.concatenate([-away[:, ::-1], away], axis=1)
        density = np.concatenate([each[:, ::-1], each], axis=1)
        self._density = self._length[:, None] * density / len(self._window)

    @cached_property
    def _window(self) -> Array:
        return window_frequencies(self._q)

    @property
    def shadow_magnification(self) -> float:
        return float(self._shadow_magnification)

    @property
    def fresnel_zone_frequency(self) -> float:
        """Cycles per metre that light takes to spread over a Fresnel zone on its way."""
        return 1 / math.sqrt(self._fresnel_area)

    @cached_property
    def max_window_frequency(self) -> Array:
        """The largest frequency behind the lens that goes to the samples, along y and x."""
        q = self._q
        far = [float(q.samples.coordinates(axis).abs().max()) for axis in (0, 1)]
        return np.array(far) / q.scale

    def lens_frequency_shift(self, at: Array) -> Array:
        """Cycles per metre by which the lens turns light at places (..., 2) in its plane."""
        q = self._q
        place = torch.from_numpy(at / q.radius).requires_grad_()
        phase = pupil_phase(
            q.lens, q.object_to_lens_distance, q.wavelength, place[..., 0], place[..., 1]
        )
        if not phase.requires_grad:
            return np.zeros_like(at)
        (found,) = torch.autograd.grad(phase.sum(), place)
        return np.asarray(found.numpy() / (2 * math.pi * q.radius))

    def trace_rays(self, at: Array, behind: Array) -> RaySamples:
        """Light that has the frequencies `behind` the lens, before the lens turns it there."""
        frequency = self._shadow_magnification * behind
        start = at / self._shadow_magnification - self._shift - self._fresnel_area * frequency
        sent = self._pixel_envelope(frequency)
        return RaySamples(frequency, start, sent * self._panel_illumination(start), sent)

    def _pixel_envelope(self, frequency: Array) -> Array:
        """A pixel's envelope sinc², and beyond its first zero the mean over its lobes."""
        turns = np.abs(frequency) * self._camera.panel.active_side
        lobes = 0.5 / (math.pi * np.maximum(turns, 1.0)) ** 2
        return np.asarray(np.prod(np.where(turns < 1, np.sinc(turns) ** 2, lobes), axis=-1))

    def _panel_illumination(self, start: Array) -> Array:
        """1 on the panel, and beside it what its own edges bend: at the distance x in the shadow
        of an edge, fresnel_area / (2 pi x)² (Fresnel's integrals, far from the edge)."""
        light = np.ones(start.shape[:-1])
        for axis in (0, 1):
            beside = self._distance_from_panel(start[..., axis], axis)
            light *= np.minimum(
                1.0, self._fresnel_area / np.maximum((2 * math.pi * beside) ** 2, 1e-300)
            )
        return light

    def _distance_from_panel(self, place: Array, axis: int) -> Array:
        """Metres from the panel's nearest edge along an axis, 0 on the panel."""
        line = self._camera.panel.plane.coordinates(axis)
        half = self._camera.panel.pitch / 2
        below, above = float(line[0]) - half - place, place - float(line[-1]) - half
        return np.maximum(np.maximum(below, above), 0.0)

    def _is_on_panel(self, place: Array) -> NDArray[np.bool_]:
        return (self._distance_from_panel(place[..., 0], 0) == 0) & (
            self._distance_from_panel(place[..., 1], 1) == 0
        )

    @cached_property
    def _opening_bounds(self) -> tuple[Array, Array]:
        """Lowest and highest place (y, x) of the stop's opening, in radii: a hole may be small."""
        low, high = zip(*(stop_extent(self._camera, axis) for axis in (0, 1)), strict=True)
        return np.array(low), np.array(high)

    @cached_property
    def _stop_coordinates(self) -> tuple[Array, Array]:
        """Places along y and x across the stop's opening, metres."""
        low, high = self._opening_bounds
        line = (np.arange(_STOP_SAMPLES) + 0.5) / _STOP_SAMPLES
        y, x = self._q.radius * (low + np.outer(line, high - low)).T
        return y, x

    @cached_property
    def _open_mask(self) -> NDArray[np.bool_]:
        """Which crossings of the lines are open."""
        y, x = np.meshgrid(
            *(line / self._q.radius for line in self._stop_coordinates), indexing="ij"
        )
        stop = self._q.lens.stop
        inside = np.asarray(stop.opening.contains(y, x))
        for shape in stop.obscurations:
            inside &= ~shape.contains(y, x)
        return inside

    @cached_property
    def _open_points(self) -> Array:
        """The open ones, (n, 2) for y and x."""
        y, x = np.meshgrid(*self._stop_coordinates, indexing="ij")
        return np.stack([y[self._open_mask], x[self._open_mask]], axis=-1)

    @cached_property
    def _direct_rays(self) -> RaySamples:
        """Light that goes straight through the stop into the window, (places, window, 2)."""
        at = self._open_points
        return self.trace_rays(at[:, None], self._window - self.lens_frequency_shift(at)[:, None])

    @cached_property
    def direct_area(self) -> float:
        """Square metres of the stop from which the window is lit, each weighed by the light."""
        low, high = self._opening_bounds
        each = float(np.prod(high - low)) * (self._q.radius / _STOP_SAMPLES) ** 2
        return float(self._direct_rays.light.mean(axis=1).sum()) * each

    @cached_property
    def passing_band(self) -> tuple[Array, Array]:
        """The lowest and highest frequencies (y, x) that go straight into the window's samples,
        from wherever the panel is lit; with room for a Fresnel zone, but not beyond all that go
        there from anywhere."""
        rays, room = self._direct_rays, self._shadow_magnification * self.max_window_frequency / 2
        lit = rays.light > _MIN_RELATIVE_LIGHT * rays.light.max(initial=0.0)
        if not lit.any():
            return -room - self.fresnel_zone_frequency, room + self.fresnel_zone_frequency
        low, high = (end(rays.frequency[lit], axis=0) for end in (np.min, np.max))
        least, most = (end(rays.frequency, axis=(0, 1)) for end in (np.min, np.max))
        low, high = (
            np.maximum(low - self.fresnel_zone_frequency, least),
            np.minimum(high + self.fresnel_zone_frequency, most),
        )
        return np.asarray(low - room), np.asarray(high + room)

    @cached_property
    def speckle_count(self) -> float:
        """About how many of them a window has, behind an evenly lit panel."""
        q = self._q
        rows, columns = (k - 2 * q.margin for k in q.samples.shape)
        area = rows * columns * q.samples.pitch[0] * q.samples.pitch[1]
        return max(1.0, area * self.direct_area / q.scale**2)

    @property
    def share_per_frequency_area(self) -> float:
        """Of the point's light, what an evenly lit panel sends to a unit of frequency area."""
        return self.direct_area * self._camera.panel.active_side**2 / open_area(self._camera)

    @property
    def window_share(self) -> float:
        """Of an evenly lit panel's light, what goes into the window."""
        q = self._q
        rows, columns = (k - 2 * q.margin for k in q.samples.shape)
        area = rows * columns * q.samples.pitch[0] * q.samples.pitch[1]
        return self.share_per_frequency_area * area / q.scale**2

    @cached_property
    def _passing_kernels(self) -> list[tuple[Array, Array]]:
        """Frequencies all over the band that passes, and how a pixel sends to them, so that the
        squares of what is sent add up to light; along each axis."""
        panel, found = self._camera.panel, []
        for axis in (0, 1):
            low, high = (float(end[axis]) for end in self.passing_band)
            f = np.linspace(low, high, 4 * panel.shape[axis])
            step = (high - low) / (f.size - 1)
            strength = np.sinc(f * panel.active_side) * math.sqrt(step * panel.active_side)
            found.append((f, strength))
        return found

    @cached_property
    def passing_share(self) -> float:
        """Of an evenly lit panel's light, what has frequencies that pass."""
        return float(np.prod([(strength**2).sum() for _, strength in self._passing_kernels]))

    def passing_brightness(self, field: torch.Tensor) -> tuple[float, float]:
        """Brightness of a panel at frequencies that pass, over that of an evenly lit one.

        The least and the most in a batch; field: (..., rows, columns) of the panel.
        """
        power = field.real**2 + field.imag**2
        total = power.sum(dim=(-2, -1), dtype=torch.float64)
        inward = []
        for axis, (f, strength) in enumerate(self._passing_kernels):
            turns = -torch.outer(torch.from_numpy(f), self._camera.panel.plane.coordinates(axis))
            kernel = unit_phasor(turns, torch.complex128) * torch.from_numpy(strength)[:, None]
            inward.append(kernel.to(field))
        straight = inward[0] @ field @ inward[1].mT
        light = (straight.real**2 + straight.imag**2).sum(dim=(-2, -1), dtype=torch.float64)
        found = light / total.clamp(min=1e-300) / self.passing_share
        return (float(found.min()), float(found.max())) if found.numel() else (1.0, 1.0)

    @cached_property
    def _accepted_frequencies(self) -> Array:
        """Frequencies before the lens that the window accepts at the edge: (edge, window, 1, 2)."""
        return np.asarray(self._window - self.lens_frequency_shift(self._edge_points)[:, None])[
            :, :, None
        ]

    @cached_property
    def scattered_rays(self) -> RaySamples:
        """The light that the edge scatters into the window, (edge, window, distance, 2)."""
        rays = self.trace_rays(
            self._edge_points[:, None, None], self._accepted_frequencies - self.edge_frequency_shift
        )
        weight = self._density[:, None]
        return RaySamples(
            rays.frequency, rays.panel_position, rays.light * weight, rays.unbounded_light * weight
        )

    def aliased_light(
        self, alias_frequency: Array, low: Array, high: Array, edge_transmission: Array
    ) -> float:
        """Light of a band (low, high) that a grid's own frequency brings into the window.

        alias_frequency: cycles per metre (y, x) by which it arrives beside the window.
        edge_transmission: share of the field that the grid's edge passes, by its turn (edge, 1,
        distance). The window's middle stands for all of it.
        """
        behind = (
            self._accepted_frequencies[:, 0] + alias_frequency - self.edge_frequency_shift[:, 0]
        ).reshape(-1, 2)
        inside = np.flatnonzero(is_in_band(self._shadow_magnification * behind, low, high))
        edge = inside // self.edge_frequency_shift.shape[2]
        light = self.trace_rays(self._edge_points[edge], behind[inside]).light
        weight = (self._density * len(self._window) * edge_transmission[:, 0] ** 2).ravel()
        return float(light @ weight[inside])

    @cached_property
    def edge_frequency_shift(self) -> Array:
        """By which frequency the edge turns the light: (edge, 1, distance, 2)."""
        return np.asarray(self._normal[:, None, None] * self._normal_distances[:, None, :, None])

    def relative_error(self, lost_light: float) -> float:
        """Relative L2 error of an intensity whose field lacks that much."""
        if not self.direct_area > 0:
            return math.inf
        return (
            self._safety_factor
            * self._pixel_averaging_factor
            * math.sqrt(lost_light / self.direct_area)
        )

    def allowed_light_loss(self, error: float) -> float:
        """The light that may be lost for a relative L2 error of the intensity."""
        return (
            error / (self._safety_factor * self._pixel_averaging_factor)
        ) ** 2 * self.direct_area

    @cached_property
    def _pixel_averaging_factor(self) -> float:
        """What is left of a relative error when light is integrated over pixels.

        Light from two places that are g apart in frequency makes fringes, of which a pixel of
        side p keeps sinc²(g p) of the power. Of an evenly lit panel's light |U|², half of the
        power is its mean, and half are fringes of any two places in the stop; the error
        2 Re(U* e) is all fringes, of the stop's places with those of its edge (Goodman,
        Statistical Optics, §7.5, for either alone).
        """
        rim = self.scattered_rays.light.sum(axis=(1, 2))
        if not (any(self._q.pixel) and self.direct_area > 0 and rim.any()):
            return 1.0
        beating = self._fringe_power_share(self._edge_points) @ rim / rim.sum()
        return math.sqrt(2 * float(beating) / self.normalised_second_moment)

    @cached_property
    def normalised_second_moment(self) -> float:
        """Mean square of an evenly lit panel's light in the window over the square of its mean:
        2 for samples of speckles, less for pixels that average them."""
        if not (any(self._q.pixel) and self.direct_area > 0):
            return 2.0
        light = self._direct_rays.light.mean(axis=1)
        return 1 + float(self._fringe_power_share(self._open_points) @ light / light.sum())

    def _fringe_power_share(self, at: Array) -> Array:
        """Share of their power that pixels keep, of fringes of all light in the stop with that
        of each place (n, 2) at the lens."""
        light = np.zeros(self._open_mask.shape)
        light[self._open_mask] = self._direct_rays.light.mean(axis=1)
        down, along = (
            np.sinc(
                np.subtract.outer(at[:, axis], self._stop_coordinates[axis]) / self._q.scale * side
            )
            ** 2
            for axis, side in enumerate(self._q.pixel)
        )
        return np.asarray(((down @ light) * along).sum(axis=1) / light.sum())

    @property
    def _safety_factor(self) -> float:
        return _MANY_SPECKLES_FACTOR + _FEW_SPECKLES_FACTOR / math.sqrt(self.speckle_count)

    def error_from_light_share(self, share: float) -> float:
        """Relative L2 error of an intensity of whose light so large a share is wrong."""
        return self._safety_factor * math.sqrt(share)

    @cached_property
    def _collapse_light_errors(self) -> tuple[float, float]:
        """Light that is wrong where the stop's shadow on the panel stands for the stop: of
        frequencies that pass, and of all.

        Light of the frequency f that the edge turns to g has run on by the phase
        pi fresnel_area (g² - f²) where the panel stands apart.
        """
        rays = self.scattered_rays
        goes = self._shadow_magnification * self._accepted_frequencies
        turn = math.pi * self._fresnel_area * ((goes**2).sum(-1) - (rays.frequency**2).sum(-1))
        shadow = self._is_on_panel(self._edge_points / self._shadow_magnification - self._shift)[
            :, None, None
        ]
        dark = self._pixel_envelope(rays.frequency) * self._density[:, None]
        lit = (rays.light + np.where(shadow, dark, 0.0)) / 2
        lost = lit * (2 - 2 * np.cos(turn))
        return float(lost[is_in_band(rays.frequency, *self.passing_band)].sum()), float(lost.sum())

    def collapse_error(self) -> float:
        """What it costs to put the stop's shadow on the panel in place of the stop."""
        return self.relative_error(self._collapse_light_errors[1])

    @property
    def collapse_passing_share(self) -> float:
        """Share of that error's square that light of frequencies that pass makes."""
        within, whole = self._collapse_light_errors
        return within / whole if whole > 0 else 0.0


def _normal_distance_steps(low: float, high: float, pieces: int) -> Array:
    """Ends of the steps in distance from an edge's own frequency, (pieces, steps + 1), cycles a
    metre; those nearer than `low` first.

    Every piece of the edge has other steps (by the golden ratio, so that neighbours' fill each
    other's gaps): where a band ends, or the panel, is told much finer than by a step.
    """
    high = max(high, 4 * low)
    shift = ((np.arange(pieces) + 0.5) * (math.sqrt(5) - 1) / 2) % 1
    number = np.arange(_FAR_STEPS + 1) + shift[:, None]
    far = low * (high / low) ** (number / _FAR_STEPS)
    near = np.broadcast_to(np.linspace(0, low, _NEAR_STEPS + 1), (pieces, _NEAR_STEPS + 1))
    return np.concatenate([near, far], axis=1)


def is_in_band(frequency: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Which frequencies (..., 2) are in a band; low, high: (2,) for y and x."""
    y, x = frequency[..., 0], frequency[..., 1]
    return np.asarray((y >= low[0]) & (y <= high[0]) & (x >= low[1]) & (x <= high[1]))


def window_frequencies(q: PSFRequest) -> Array:
    """Frequencies (y, x) behind the lens that go to places in the window, (places, 2)."""
    rows, columns = q.window_slices
    lines = (q.samples.coordinates(0)[rows], q.samples.coordinates(1)[columns])
    (y0, y1), (x0, x1) = ((float(line[0]), float(line[-1])) for line in lines)
    middle = np.array([y0 + y1, x0 + x1]) / 2
    half = np.array([y1 - y0, x1 - x0]) / 2
    corners = [[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]
    return np.asarray((middle + 2 * _WINDOW_PROBE_OFFSET * half * np.array(corners)) / q.scale)


def _sample_stop_edge(camera: Camera, radius: float) -> tuple[Array, Array, Array]:
    """Places along the stop's boundary, its normals there, and lengths; metres."""
    pieces = [piece for loop in camera.lens.stop.loops for piece in loop.pieces]
    count = max(4, _EDGE_PIECES // len(pieces))
    t = (np.arange(count) + 0.5) / count
    at, along = (
        np.concatenate([np.stack(np.broadcast_arrays(*part), axis=-1) for part in parts])
        for parts in (
            [piece.points(t) for piece in pieces],
            [piece.velocity(t) for piece in pieces],
        )
    )
    speed = np.hypot(along[:, 0], along[:, 1])
    normal = np.stack([along[:, 1], -along[:, 0]], axis=-1) / speed[:, None]
    return at * radius, normal, speed / count * radius
