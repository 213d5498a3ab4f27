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
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera
from optics.camera.pupil import open_area, pupil_phase
from optics.fourier import unit_phasor
from optics.psf.axes import stop_extent
from optics.psf.request import PSFRequest

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EdgeScatterSettings:
    """Tune how the light that the stop's edge scatters is estimated.

    edge_pieces: pieces into which the stop's edge is divided. Chosen.
    far_steps: steps in frequency on either side of an edge, at distances D above 1 / (4 radius).
    Chosen. Where light is followed farther than usual, they are wider.
    near_steps: steps in frequency on either side, at smaller distances. Chosen.
    stop_samples: samples across the stop. Chosen.
    max_cycles_per_pixel: cycles per panel pixel up to which scattered light is followed. Beyond,
    the pixel's envelope leaves a negligible share.
    many_speckles_factor: factor on an estimate for an evenly lit panel, if the window holds many
    speckles. Random patterns need less, because rays light the ends of the panel's shadow fully.
    Gratings and smooth waves on small panels need up to a fifth more than without it.
    few_speckles_factor: addition to that factor for a single speckle; it is divided by the square
    root of the number of speckles.
    few_rim_speckles_factor: addition to that factor for a single speckle along the stop's edge; it
    is divided by the square root of their number, by which the light that the edge gets is known.
    Set to four standard deviations: on small panels, some waves and gratings exceeded the other two
    factors by 2.2, with 20 speckles.
    min_relative_light: share of the brightest light below which a ray counts as dark. Chosen.
    window_probe_offset: distance of the points that represent the window from its middle, in sides
    of the window. Chosen.
    """

    edge_pieces: int = 96
    far_steps: int = 48
    near_steps: int = 6
    stop_samples: int = 40
    max_cycles_per_pixel: float = 40.0
    many_speckles_factor: float = 1.3
    few_speckles_factor: float = 2.5
    few_rim_speckles_factor: float = 4.0
    min_relative_light: float = 0.02
    window_probe_offset: float = 1 / 3


_SETTINGS = EdgeScatterSettings()


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
    """Estimates the light that goes from the panel by way of the stop's edge into a window."""

    def __init__(self, request: PSFRequest, camera: Camera, max_cycles: float = 0.0) -> None:
        """max_cycles: cycles per pixel up to which light is followed, if more than usual."""
        self._q, self._camera = request.numeric, camera
        q = self._q
        self._shadow_magnification = q.shadow_magnification
        self._shift = np.array([sine * q.separation for sine in q.chief_ray_slopes])
        self._fresnel_area = q.wavelength * camera.separation / self._shadow_magnification
        self._edge_points, self._normal, self._length = _sample_stop_edge(camera, q.radius)
        low = 1 / (4 * q.radius)
        cycles = max(max_cycles, _SETTINGS.max_cycles_per_pixel)
        edges = _normal_distance_steps(low, cycles / camera.panel.active_side, len(self._length))
        away, step = (edges[:, 1:] + edges[:, :-1]) / 2, np.diff(edges)
        area, rim = q.lens.stop.area * q.radius**2, self._length.sum()
        whole = math.pi * away * area**2 / rim
        each = np.where(away < low, whole, 1 / (4 * math.pi**2 * away**2)) * step
        self._normal_distances = np.concatenate([-away[:, ::-1], away], axis=1)
        density = np.concatenate([each[:, ::-1], each], axis=1)
        self._density = self._length[:, None] * density / len(self._window)

    def without_limit(self) -> StopEdgeScatter:
        """Return an estimate that follows all light between panel and stop, however oblique.

        Small tolerances take more than the usual cycles per pixel.
        """
        panel = self._camera.panel
        farthest = math.hypot(*panel.shape) * panel.pitch / 2 + math.hypot(*self._shift)
        farthest += self._q.radius / self.shadow_magnification
        cycles = farthest / self._fresnel_area * panel.active_side
        return StopEdgeScatter(self._q, self._camera, cycles)

    @cached_property
    def _window(self) -> Array:
        """The frequencies behind the lens that represent the window, (points, 2)."""
        return window_frequencies(self._q)

    @property
    def shadow_magnification(self) -> float:
        return float(self._shadow_magnification)

    @property
    def fresnel_zone_frequency(self) -> float:
        """The inverse of the Fresnel zone's width between panel and lens, cycles/m."""
        return 1 / math.sqrt(self._fresnel_area)

    @cached_property
    def max_window_frequency(self) -> Array:
        """The largest frequencies (y, x) behind the lens that reach sensor samples, cycles/m."""
        q = self._q
        far = [float(q.samples.coordinates(axis).abs().max()) for axis in (0, 1)]
        return np.array(far) / q.scale

    def lens_frequency_shift(self, at: Array) -> Array:
        """Return how far the lens shifts the light's frequency at points, cycles/m.

        at: metres, (..., 2).
        """
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
        """Trace rays from points in the lens' plane back to the panel.

        at: the points, metres, (..., 2).
        behind: the rays' frequencies just before the lens, cycles per metre, (..., 2).
        """
        frequency = self._shadow_magnification * behind
        start = at / self._shadow_magnification - self._shift - self._fresnel_area * frequency
        sent = self._pixel_envelope(frequency)
        return RaySamples(frequency, start, sent * self._panel_illumination(start), sent)

    def _pixel_envelope(self, frequency: Array) -> Array:
        """Return the envelope sinc² of a panel pixel at a frequency.

        Beyond its first zero, the envelope is averaged over the lobes.
        """
        turns = np.abs(frequency) * self._camera.panel.active_side
        lobes = 0.5 / (math.pi * np.maximum(turns, 1.0)) ** 2
        along = np.where(turns < 1, np.sinc(turns) ** 2, lobes)
        return np.asarray(along[..., 0] * along[..., 1])

    def _panel_illumination(self, start: Array) -> Array:
        """Return the relative irradiance on the panel and beside it.

        It is 1 on the panel. Beside it, at the distance x from the edge, diffraction leaves
        fresnel_area / (2 pi x)² (Fresnel's integrals, far from the edge).
        """
        light = np.ones(start.shape[:-1])
        for axis in (0, 1):
            beside = self._distance_from_panel(start[..., axis], axis)
            light *= np.minimum(
                1.0, self._fresnel_area / np.maximum((2 * math.pi * beside) ** 2, 1e-300)
            )
        return light

    def _distance_from_panel(self, place: Array, axis: int) -> Array:
        """Return the distance to the panel along an axis in metres, 0 on the panel."""
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
        """The lowest and highest (y, x) of the stop's opening, in stop radii.

        The opening may be much smaller than the circle around it, so samples cover only the
        opening.
        """
        low, high = zip(*(stop_extent(self._camera, axis) for axis in (0, 1)), strict=True)
        return np.array(low), np.array(high)

    @cached_property
    def _stop_coordinates(self) -> tuple[Array, Array]:
        """The y and x coordinates of the samples across the stop's opening, in metres."""
        low, high = self._opening_bounds
        line = (np.arange(_SETTINGS.stop_samples) + 0.5) / _SETTINGS.stop_samples
        y, x = self._q.radius * (low + np.outer(line, high - low)).T
        return y, x

    @cached_property
    def _open_mask(self) -> NDArray[np.bool_]:
        """Whether the stop is open at each sample of `_stop_coordinates`."""
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
        """The samples where the stop is open, (n, 2) for y and x, in metres."""
        y, x = np.meshgrid(*self._stop_coordinates, indexing="ij")
        return np.stack([y[self._open_mask], x[self._open_mask]], axis=-1)

    @cached_property
    def _direct_rays(self) -> RaySamples:
        """The rays that go straight through the stop into the window.

        Positions and frequencies are (points, window, 2).
        """
        at = self._open_points
        return self.trace_rays(at[:, None], self._window - self.lens_frequency_shift(at)[:, None])

    @cached_property
    def direct_area(self) -> float:
        """The area of the stop that lights the window, weighted by the light, in m²."""
        low, high = self._opening_bounds
        each = float(np.prod(high - low)) * (self._q.radius / _SETTINGS.stop_samples) ** 2
        return float(self._direct_rays.light.mean(axis=1).sum()) * each

    @cached_property
    def passing_band(self) -> tuple[Array, Array]:
        """The lowest and highest panel frequencies that go straight to the window, cycles/m.

        The limits (y, x) are the frequencies of rays from the lit panel, widened by a Fresnel zone.
        The band isn't wider than that of an infinitely large panel.
        """
        rays, room = self._direct_rays, self._shadow_magnification * self.max_window_frequency / 2
        lit = rays.light > _SETTINGS.min_relative_light * rays.light.max(initial=0.0)
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
        """The approximate number of speckles in the window, behind an evenly lit panel."""
        q = self._q
        rows, columns = (
            k - 2 * margin for k, margin in zip(q.samples.shape, q.margin, strict=True)
        )
        area = rows * columns * q.samples.pitch[0] * q.samples.pitch[1]
        return max(1.0, area * self.direct_area / q.scale**2)

    @property
    def share_per_frequency_area(self) -> float:
        """The share of its light that an evenly lit panel sends to a unit frequency area.

        The unit is m², because frequencies are in cycles per metre.
        """
        return self.direct_area * self._camera.panel.active_side**2 / open_area(self._camera)

    @property
    def window_share(self) -> float:
        """The share of an evenly lit panel's light that reaches the window."""
        q = self._q
        rows, columns = (
            k - 2 * margin for k, margin in zip(q.samples.shape, q.margin, strict=True)
        )
        area = rows * columns * q.samples.pitch[0] * q.samples.pitch[1]
        return self.share_per_frequency_area * area / q.scale**2

    @cached_property
    def _passing_kernels(self) -> list[tuple[Array, Array]]:
        """For each axis, frequencies in the passing band, and a pixel's amplitude at each.

        The amplitudes are scaled so that the sum of their squares is the light in the band.
        """
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
        """Compute a panel's brightness in the passing band, over an evenly lit panel's.

        Returns the least and the greatest of a batch.

        field: of the panel, (..., rows, columns).
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
        """The frequencies before the lens that reach the window from the stop's edge.

        The shape is (edge, window, 1, 2).
        """
        return np.asarray(self._window - self.lens_frequency_shift(self._edge_points)[:, None])[
            :, :, None
        ]

    @cached_property
    def scattered_rays(self) -> RaySamples:
        """The rays that the stop's edge scatters into the window.

        Positions and frequencies are (edge, window, distance, 2).
        """
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
        """Estimate the light that aliasing on the lens grid adds to the window.

        The window's middle represents all of the window.

        alias_frequency: cycles per metre (y, x) by which the sampled stop shifts the light.
        low, high: limits (y, x) of the band of panel frequencies from which the light comes.
        edge_transmission: share of the field that the grid's averaged edge passes, by its shift in
        frequency, (edge, 1, distance).
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
        """The frequency shifts by the stop's edge, (edge, 1, distance, 2), cycles/m."""
        return np.asarray(self._normal[:, None, None] * self._normal_distances[:, None, :, None])

    def relative_error(self, lost_light: float) -> float:
        """Return the relative L2 error of the intensity if the field lacks `lost_light`."""
        if not self.direct_area > 0:
            return math.inf
        return (
            self._safety_factor
            * self._pixel_averaging_factor
            * math.sqrt(lost_light / self.direct_area)
        )

    def allowed_light_loss(self, error: float) -> float:
        """Return the light that may be lost for a given relative L2 error of the intensity."""
        return (
            error / (self._safety_factor * self._pixel_averaging_factor)
        ) ** 2 * self.direct_area

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
        return 1 + float(self._fringe_power_share(self._open_points) @ light / light.sum())

    def _fringe_power_share(self, at: Array) -> Array:
        """Return the share of the fringe power that sensor pixels keep.

        All light in the stop makes fringes with the light from each point `at`, (n, 2) in the lens'
        plane.
        """
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
        few = _SETTINGS.few_speckles_factor / math.sqrt(self.speckle_count)
        rim = _SETTINGS.few_rim_speckles_factor / math.sqrt(self._rim_speckle_count)
        return _SETTINGS.many_speckles_factor + few + rim

    @property
    def _rim_speckle_count(self) -> float:
        """The approximate number of speckles of the panel's light along the stop's edge."""
        panel = self._camera.panel
        width = math.sqrt(math.prod(panel.shape)) * panel.pitch
        return max(1.0, float(self._length.sum()) * width / self._fresnel_area)

    def error_from_light_share(self, share: float) -> float:
        """Return the relative L2 error of the intensity if a share of the light is wrong."""
        return self._safety_factor * math.sqrt(share)

    @cached_property
    def _collapse_light_errors(self) -> tuple[float, float]:
        """The light that is wrong if the stop's shadow on the panel replaces the stop.

        The first number is for frequencies in the passing band, the second for all. Between panel
        and stop, light of the frequency f that the edge turns to g gains the phase
        pi fresnel_area (g² - f²), which the shadow on the panel doesn't give.
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
        """Return the relative error if the stop's shadow on the panel replaces the stop."""
        return self.relative_error(self._collapse_light_errors[1])

    @property
    def collapse_passing_share(self) -> float:
        """The share of the squared `collapse_error` that comes from the passing band."""
        within, whole = self._collapse_light_errors
        return within / whole if whole > 0 else 0.0


def _normal_distance_steps(low: float, high: float, pieces: int) -> Array:
    """Return the limits of steps in frequency away from the stop's edge, cycles/m.

    The shape is (pieces, steps + 1); steps nearer than `low` come first. Every piece of the edge
    has its own steps, shifted by the golden ratio, so that the steps of neighbouring pieces
    interleave. The ends of a band or of the panel are thus resolved much finer than one step.
    """
    far_steps, near_steps = _SETTINGS.far_steps, _SETTINGS.near_steps
    high = max(high, 4 * low)
    shift = ((np.arange(pieces) + 0.5) * (math.sqrt(5) - 1) / 2) % 1
    number = np.arange(far_steps + 1) + shift[:, None]
    far = low * (high / low) ** (number / far_steps)
    near = np.broadcast_to(np.linspace(0, low, near_steps + 1), (pieces, near_steps + 1))
    return np.concatenate([near, far], axis=1)


def is_in_band(frequency: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Tell which panel frequencies (..., 2) lie in a band.

    low, high: limits, (2,) for y and x.
    """
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
    away = 2 * _SETTINGS.window_probe_offset * half * np.array(corners)
    return np.asarray((middle + away) / q.scale)


def _sample_stop_edge(camera: Camera, radius: float) -> tuple[Array, Array, Array]:
    """Divide the stop's edge into pieces: midpoints in metres, normals, lengths in metres."""
    pieces = [piece for loop in camera.lens.stop.loops for piece in loop.pieces]
    count = max(4, _SETTINGS.edge_pieces // len(pieces))
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
