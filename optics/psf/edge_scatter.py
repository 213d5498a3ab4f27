"""Estimate the light that a stop's edge scatters into a window.

A cheaper method of the chain may neglect part of this light, and its error is estimated from it.

In the far field, a straight edge of length l under a plane wave of irradiance I scatters the
spectral density I l / (4 pi² D²) per cycle along its normal, at the normal distance D in
frequency (the Fourier integral of a half plane; Keller's edge rays, 10.1364/JOSA.52.000116).
The panel's pixels send light of all frequencies. The part of it that reaches a piece of the edge is
scattered in this way into the few frequencies that the window receives. The part that a method
treats wrongly is summed over the edge, the window and D, and compared with the light that goes
straight into the window. For D below 1 / (4 radius) the edges on both sides of the stop act
together: a stop of area S sends S² to a unit of frequency area at most, which is 2 pi D S² per
cycle, distributed over the pieces of the edge. For a round stop both parts together give 1.02 of
the light.

The pattern isn't known when the method is planned. So the panel counts as evenly lit at all of its
frequencies, under the envelope sinc² of one pixel, as behind a random pattern. For such a panel the
relative error of the intensity equals that of the field. It is smaller where the intensity is
integrated over sensor pixels, because light from the edge and light from elsewhere in the stop
interfere in fine fringes, which a pixel averages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera
from optics.camera.pupil import open_area, pupil_phase
from optics.fourier import unit_phasor
from optics.psf.request import PSFRequest

Array = NDArray[np.float64]


_EDGE_PIECES = 96  # into which the stop's edge is divided; chosen
_FAR_STEPS = 48  # in frequency on either side of an edge, beyond 1 / (4 radius); chosen
_NEAR_STEPS = 6  # the same at smaller distances; chosen
_STOP_SAMPLES = 40  # across the stop; chosen
_MOST_CYCLES = 40.0  # per panel pixel that are followed; a pixel's envelope leaves little beyond
_LEAST_RELATIVE_LIGHT = 0.02  # of the brightest ray, below which a ray counts as dark; chosen
_WINDOW_PROBE_OFFSET = 1 / 3  # of the points that stand for the window, in its sides; chosen

# Factor on an estimate for an evenly lit panel, if the window holds many speckles. Random
# patterns need less, because rays light the ends of the panel's shadow fully. Gratings and smooth
# waves on small panels need up to a fifth more than without it.
_MANY_SPECKLES_FACTOR = 1.3

# Addition to that factor for one speckle in the window, over the root of their number.
_FEW_SPECKLES_FACTOR = 2.5

# The same for speckles along the stop's edge, by whose number the light that the edge gets is
# known. Four standard deviations: on small panels, some waves and gratings exceeded the other two
# factors by 2.2, with 20 speckles.
_FEW_RIM_SPECKLES_FACTOR = 4.0


def fresnel_area(q: PSFRequest) -> float:
    """Return the Fresnel area of the space between panel and lens, in m².

    On the way, light moves sideways by its frequency times this area, in the panel's coordinates.
    """
    return float(q.wavelength * q.separation / q.shadow_magnification)


@dataclass(frozen=True)
class RaySamples:
    """Rays of light at points in the lens' plane; arrays (..., 2) hold y and x.

    frequency: cycles per metre at the panel, (..., 2).
    panel_position: where the ray leaves the panel, metres, (..., 2).
    light: density of the light, 0 where the panel sends none.
    unbounded_light: density that it would have if the panel were infinitely large.
    """

    frequency: Array
    panel_position: Array
    light: Array
    unbounded_light: Array


class StopEdgeScatter:
    """Estimates the light that goes from the panel by way of the stop's edge into a window.

    max_cycles: cycles per pixel up to which light is followed, if more than usual.
    """

    def __init__(self, request: PSFRequest, camera: Camera, max_cycles: float = 0.0) -> None:
        self._q, self._camera = request.numeric, camera
        q = self._q
        self.shadow_magnification = float(q.shadow_magnification)
        self._shift = np.array([sine * q.separation for sine in q.chief_ray_slopes])
        self._fresnel_area = fresnel_area(q)
        self.fresnel_zone_frequency = 1 / math.sqrt(self._fresnel_area)
        """The inverse of the Fresnel zone's width between panel and lens, cycles/m."""
        far = [float(q.samples.coordinates(axis).abs().max()) for axis in (0, 1)]
        self.max_window_frequency = np.array(far) / q.scale
        """The largest frequencies (y, x) behind the lens that reach sensor samples, cycles/m."""
        self._window = window_frequencies(q)
        lines = [camera.panel.plane.coordinates(axis) for axis in (0, 1)]
        self._pixel_ends = [(float(line[0]), float(line[-1])) for line in lines]
        inside = q.samples.shape[0] - 2 * q.margin[0], q.samples.shape[1] - 2 * q.margin[1]
        self._window_area = inside[0] * inside[1] * q.samples.pitch[0] * q.samples.pitch[1]
        self._edge_points, normal, self._length = _sample_stop_edge(camera, q.radius)
        low = 1 / (4 * q.radius)
        cycles = max(max_cycles, _MOST_CYCLES)
        edges = _normal_distance_steps(low, cycles / camera.panel.active_side, len(self._length))
        away, step = (edges[:, 1:] + edges[:, :-1]) / 2, np.diff(edges)
        whole = math.pi * away * (q.lens.stop.area * q.radius**2) ** 2 / self._length.sum()
        each = np.where(away < low, whole, 1 / (4 * math.pi**2 * away**2)) * step
        distances = np.concatenate([-away[:, ::-1], away], axis=1)
        self.edge_frequency_shift: Array = normal[:, None, None] * distances[:, None, :, None]
        """The frequency shifts by the stop's edge, (edge, 1, distance, 2), cycles/m."""
        density = np.concatenate([each[:, ::-1], each], axis=1)
        self._density = self._length[:, None] * density / len(self._window)
        self._stop = _sample_stop(camera, q.radius)
        at = self._stop.open_points
        behind = self._window - self.lens_frequency_shift(at)[:, None]
        self._direct_rays = self.trace_rays(at[:, None], behind)
        """The rays that go straight through the stop into the window, (points, window)."""
        self.direct_area = float(self._direct_rays.light.mean(axis=1).sum()) * self._stop.area
        """The area of the stop that lights the window, weighted by the light, in m²."""

    def without_limit(self) -> StopEdgeScatter:
        """Return an estimate that follows all light to the stop, as small tolerances take."""
        panel = self._camera.panel
        farthest = math.hypot(*panel.shape) * panel.pitch / 2 + math.hypot(*self._shift)
        farthest += self._q.radius / self.shadow_magnification
        cycles = farthest / self._fresnel_area * panel.active_side
        return StopEdgeScatter(self._q, self._camera, cycles)

    def lens_frequency_shift(self, at: Array) -> Array:
        """Return how far the lens shifts light at points (..., 2), m, in cycles/m."""
        q = self._q
        # The slope is a derivative, whatever the caller does with derivatives.
        with torch.enable_grad():
            place = torch.from_numpy(at / q.radius).requires_grad_()
            phase = pupil_phase(
                q.lens, q.object_to_lens_distance, q.wavelength, place[..., 0], place[..., 1]
            )
            if not phase.requires_grad:
                return np.zeros_like(at)
            (found,) = torch.autograd.grad(phase.sum(), place)
        return np.asarray(found.numpy() / (2 * math.pi * q.radius))

    def trace_rays(self, at: Array, behind: Array) -> RaySamples:
        """Trace rays from points in the lens' plane, metres, (..., 2), back to the panel.

        behind: the rays' frequencies just before the lens, cycles per metre, (..., 2).
        """
        frequency = self.shadow_magnification * behind
        start = at / self.shadow_magnification - self._shift - self._fresnel_area * frequency
        lit = np.ones(start.shape[:-1])
        sent = _pixel_envelope(frequency * self._camera.panel.active_side)
        for axis in (0, 1):
            # At the distance x beside the panel, diffraction leaves fresnel_area / (2 pi x)² of its
            # irradiance (Fresnel's integrals, far from the edge).
            away = (2 * math.pi * self._distance_from_panel(start[..., axis], axis)) ** 2
            lit *= np.minimum(1.0, self._fresnel_area / np.maximum(away, 1e-300))
        return RaySamples(frequency, start, sent * lit, sent)

    def _distance_from_panel(self, place: Array, axis: int) -> Array:
        """Return the distance to the panel along an axis in metres, 0 on the panel."""
        (first, last), half = self._pixel_ends[axis], self._camera.panel.pitch / 2
        return np.maximum(np.maximum(first - half - place, place - last - half), 0.0)

    @cached_property
    def passing_band(self) -> tuple[Array, Array]:
        """The lowest and highest panel frequencies that go straight to the window, cycles/m.

        The limits (y, x) are the frequencies of rays from the lit panel, widened by a Fresnel zone.
        The band isn't wider than that of an infinitely large panel.
        """
        rays, zone = self._direct_rays, self.fresnel_zone_frequency
        room = self.shadow_magnification * self.max_window_frequency / 2
        lit = rays.light > _LEAST_RELATIVE_LIGHT * rays.light.max(initial=0.0)
        if not lit.any():
            return -room - zone, room + zone
        seen = rays.frequency[lit]
        low = np.maximum(seen.min(axis=0) - zone, rays.frequency.min(axis=(0, 1)))
        high = np.minimum(seen.max(axis=0) + zone, rays.frequency.max(axis=(0, 1)))
        return np.asarray(low - room), np.asarray(high + room)

    @cached_property
    def speckle_count(self) -> float:
        """The approximate number of speckles in the window, behind an evenly lit panel."""
        return max(1.0, self._window_area * self.direct_area / self._q.scale**2)

    @property
    def share_per_frequency_area(self) -> float:
        """The share of its light that an evenly lit panel sends to a unit frequency area, m²."""
        return self.direct_area * self._camera.panel.active_side**2 / open_area(self._camera)

    @property
    def window_share(self) -> float:
        """The share of an evenly lit panel's light that reaches the window."""
        return self.share_per_frequency_area * self._window_area / self._q.scale**2

    @cached_property
    def _passing_kernels(self) -> list[tuple[Array, Array]]:
        """Frequencies in the passing band, and what a pixel sends to each, along each axis."""
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
        """The share of an evenly lit panel's light that lies in the passing band."""
        return float(np.prod([(strength**2).sum() for _, strength in self._passing_kernels]))

    def passing_brightness(self, field: torch.Tensor) -> tuple[float, float]:
        """Compute the brightness of panels' fields in the passing band, over an evenly lit panel's.

        Returns the least and the greatest of a batch.
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
        """The frequencies before the lens from the edge to the window, (edge, window, 1, 2)."""
        shift = self.lens_frequency_shift(self._edge_points)
        return np.asarray(self._window - shift[:, None])[:, :, None]

    @cached_property
    def scattered_rays(self) -> RaySamples:
        """The rays that the stop's edge scatters into the window, (edge, window, distance)."""
        rays = self.trace_rays(
            self._edge_points[:, None, None], self._accepted_frequencies - self.edge_frequency_shift
        )
        weight = self._density[:, None]
        return replace(
            rays, light=rays.light * weight, unbounded_light=rays.unbounded_light * weight
        )

    def aliased_light(
        self, alias_frequency: Array, low: Array, high: Array, edge_transmission: Array
    ) -> float:
        """Estimate the light that aliasing on the lens grid adds to the window, by its middle.

        alias_frequency: cycles per metre (y, x) by which the sampled stop shifts the light.
        low, high: limits (y, x) of the band of panel frequencies from which the light comes.
        edge_transmission: share of the field that the grid's averaged edge passes, by its shift in
        frequency, (edge, 1, distance).
        """
        behind = (
            self._accepted_frequencies[:, 0] + alias_frequency - self.edge_frequency_shift[:, 0]
        ).reshape(-1, 2)
        inside = np.flatnonzero(is_in_band(self.shadow_magnification * behind, low, high))
        edge = inside // self.edge_frequency_shift.shape[2]
        light = self.trace_rays(self._edge_points[edge], behind[inside]).light
        weight = (self._density * len(self._window) * edge_transmission[:, 0] ** 2).ravel()
        return float(light @ weight[inside])

    def relative_error(self, lost_light: float) -> float:
        """Return the relative L2 error of the intensity if the field lacks `lost_light`."""
        if not self.direct_area > 0:
            return math.inf
        share = math.sqrt(lost_light / self.direct_area)
        return self.safety_factor * self._pixel_averaging_factor * share

    def allowed_light_loss(self, error: float) -> float:
        """Return the light that may be lost for a given relative L2 error of the intensity."""
        share = error / (self.safety_factor * self._pixel_averaging_factor)
        return share**2 * self.direct_area

    @cached_property
    def _pixel_averaging_factor(self) -> float:
        """The share of the relative error that integration over sensor pixels leaves.

        Light from two points that differ by g in frequency makes fringes. A pixel of side p keeps
        sinc²(g p) of their power. For an evenly lit panel, half of the power of |U|² is its mean,
        and half belongs to fringes between any two points in the stop. The error 2 Re(U* e)
        consists of fringes alone, between points in the stop and points on its edge (section 7.5
        of Goodman, Statistical Optics, for either alone).
        """
        rim = self.scattered_rays.light.sum(axis=(1, 2))
        if not (any(self._q.pixel) and self.direct_area > 0 and rim.any()):
            return 1.0
        beating = self._fringe_power_share(self._edge_points) @ rim / rim.sum()
        return math.sqrt(2 * float(beating) / self.normalised_second_moment)

    @cached_property
    def normalised_second_moment(self) -> float:
        """The mean square of the light in the window over its squared mean.

        The panel is evenly lit. The value is 2 for point samples of speckles, and less for pixels,
        which average them.
        """
        if not (any(self._q.pixel) and self.direct_area > 0):
            return 2.0
        light = self._direct_rays.light.mean(axis=1)
        return 1 + float(self._fringe_power_share(self._stop.open_points) @ light / light.sum())

    def _fringe_power_share(self, at: Array) -> Array:
        """Return the share of the fringe power that sensor pixels keep.

        All light in the stop makes fringes with the light from each point `at`, (n, 2) in the lens'
        plane.
        """
        lines, inside = self._stop.lines, self._stop.is_open
        light = np.zeros(inside.shape)
        light[inside] = self._direct_rays.light.mean(axis=1)
        down, along = (
            np.sinc(np.subtract.outer(at[:, axis], lines[axis]) / self._q.scale * side) ** 2
            for axis, side in enumerate(self._q.pixel)
        )
        return np.asarray(((down @ light) * along).sum(axis=1) / light.sum())

    @cached_property
    def safety_factor(self) -> float:
        """The factor on the root of a share of the light that is wrong, to the relative error."""
        panel = self._camera.panel
        width = math.sqrt(math.prod(panel.shape)) * panel.pitch
        # The speckles of the panel's light along the stop's edge.
        at_rim = max(1.0, float(self._length.sum()) * width / self._fresnel_area)
        few = _FEW_SPECKLES_FACTOR / math.sqrt(self.speckle_count)
        return _MANY_SPECKLES_FACTOR + few + _FEW_RIM_SPECKLES_FACTOR / math.sqrt(at_rim)

    def collapse_error(self) -> tuple[float, float]:
        """Return the relative error if the stop's shadow on the panel replaces the stop.

        Also returns the share of the squared error that comes from the passing band. Between panel
        and stop, light of the frequency f that the edge turns to g gains the phase
        pi fresnel_area (g² - f²), which the shadow on the panel doesn't give.
        """
        rays = self.scattered_rays
        goes = self.shadow_magnification * self._accepted_frequencies
        turn = math.pi * self._fresnel_area * ((goes**2).sum(-1) - (rays.frequency**2).sum(-1))
        shadow = self._edge_points / self.shadow_magnification - self._shift
        on_panel = [self._distance_from_panel(shadow[:, axis], axis) == 0 for axis in (0, 1)]
        dark = _pixel_envelope(rays.frequency * self._camera.panel.active_side)
        dark = dark * self._density[:, None]
        lit = (rays.light + np.where((on_panel[0] & on_panel[1])[:, None, None], dark, 0.0)) / 2
        lost = lit * (2 - 2 * np.cos(turn))
        within = float(lost[is_in_band(rays.frequency, *self.passing_band)].sum())
        whole = float(lost.sum())
        return self.relative_error(whole), within / whole if whole > 0 else 0.0


def _normal_distance_steps(low: float, high: float, pieces: int) -> Array:
    """Return the limits of steps in frequency away from the stop's edge, cycles/m.

    The shape is (pieces, steps + 1); steps nearer than `low` come first. Every piece of the edge
    has its own steps, shifted by the golden ratio, so that the steps of neighbouring pieces
    interleave. The ends of a band or of the panel are thus resolved much finer than one step.
    """
    high = max(high, 4 * low)
    shift = ((np.arange(pieces) + 0.5) * (math.sqrt(5) - 1) / 2) % 1
    number = np.arange(_FAR_STEPS + 1) + shift[:, None]
    far = low * (high / low) ** (number / _FAR_STEPS)
    near = np.broadcast_to(np.linspace(0, low, _NEAR_STEPS + 1), (pieces, _NEAR_STEPS + 1))
    return np.concatenate([near, far], axis=1)


def is_in_band(frequency: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Tell which panel frequencies (..., 2) lie in a band between two limits (y, x)."""
    y, x = frequency[..., 0], frequency[..., 1]
    return np.asarray((y >= low[0]) & (y <= high[0]) & (x >= low[1]) & (x <= high[1]))


def window_frequencies(q: PSFRequest) -> Array:
    """Return the frequencies (y, x) behind the lens of five window points, (5, 2)."""
    rows, columns = q.window_slices
    lines = (q.samples.coordinates(0)[rows], q.samples.coordinates(1)[columns])
    (y0, y1), (x0, x1) = ((float(line[0]), float(line[-1])) for line in lines)
    middle = np.array([y0 + y1, x0 + x1]) / 2
    half = np.array([y1 - y0, x1 - x0]) / 2
    corners = [[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]
    away = 2 * _WINDOW_PROBE_OFFSET * half * np.array(corners)
    return np.asarray((middle + away) / q.scale)


class _StopSamples(NamedTuple):
    """Samples across the stop's opening, in metres, and each one's area."""

    lines: tuple[Array, Array]  # y and x
    is_open: NDArray[np.bool_]
    open_points: Array  # (n, 2)
    area: float


def _sample_stop(camera: Camera, radius: float) -> _StopSamples:
    """Sample the stop's opening, which may be much smaller than the circle around it."""
    stop = camera.lens.stop
    low, high = np.transpose([stop_extent(camera, 0), stop_extent(camera, 1)])
    line = (np.arange(_STOP_SAMPLES) + 0.5) / _STOP_SAMPLES
    down, along = radius * (low + np.outer(line, high - low)).T
    y, x = np.meshgrid(down / radius, along / radius, indexing="ij")
    inside = np.asarray(stop.opening.contains(y, x))
    for shape in stop.obscurations:
        inside &= ~shape.contains(y, x)
    y, x = np.meshgrid(down, along, indexing="ij")
    area = float(np.prod(high - low)) * (radius / _STOP_SAMPLES) ** 2
    return _StopSamples((down, along), inside, np.stack([y[inside], x[inside]], axis=-1), area)


def _pixel_envelope(turns: Array) -> Array:
    """Return the envelope sinc² of a panel pixel at cycles per pixel, (..., 2).

    Beyond its first zero, the envelope is averaged over the lobes.
    """
    turns = np.abs(turns)
    lobes = 0.5 / (math.pi * np.maximum(turns, 1.0)) ** 2
    return np.asarray(np.where(turns < 1, np.sinc(turns) ** 2, lobes).prod(-1))


def stop_extent(camera: Camera, axis: int) -> tuple[float, float]:
    """Return the lowest and highest coordinate of the stop's opening, in stop radii."""
    t = np.linspace(0, 1, 257)
    opening = camera.lens.stop.loops[0]
    places = np.concatenate([piece.points(t)[axis] for piece in opening.pieces])
    return float(places.min()), float(places.max())


def _sample_stop_edge(camera: Camera, radius: float) -> tuple[Array, Array, Array]:
    """Divide the stop's edge into pieces: midpoints in metres, normals, lengths in metres."""
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
