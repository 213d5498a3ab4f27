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
from optics.chain.relay_axes import extent
from optics.fourier import unit_phasor
from optics.point.question import Question
from optics.pupil import open_area, wave_phase

Array = NDArray[np.float64]

_RIM, _STEPS, _NEAR, _SIDE = 96, 48, 6, 40
"""Pieces of the stop's edge, distances in frequency to either side, those at which the edges are
not told apart, and places across the stop."""

_FARTHEST = 40.0
"""Cycles per pixel beyond which its envelope leaves no light that counts."""

_SAFE, _FEW = 0.95, 2.5
"""What an estimate for an evenly lit panel is multiplied by: for many speckles in the window,
where it was measured to be too large by a quarter to a half, since rays light the ends of the
panel's shadow fully; and for a single one, as the square root of their number falls."""

_LIT = 0.02
"""Of the brightest light, what counts as light at all."""

_CLEAR = 1 / 3
"""Of a window's sides from its middle: where it is looked at, to stand for all of it."""


@dataclass(frozen=True)
class Rays:
    """Light at places in the lens' plane, (..., 2) for y and x.

    frequency: cycles per metre at the panel. start: metres on the panel that it comes from.
    light: its density, 0 where the panel sends none. anywhere: what it would be if the panel had
    no end, so that it wouldn't matter where the light comes from.
    """

    frequency: Array
    start: Array
    light: Array
    anywhere: Array


class EdgeLight:
    """The edge of a camera's stop, and what goes from the panel by way of it into a window."""

    def __init__(self, question: Question, camera: Camera) -> None:
        self._q, self._camera = question.numeric, camera
        q = self._q
        self._spread = q.spread
        self._shift = np.array([sine * q.separation for sine in q.sines])
        self._bend = q.wavelength * camera.separation / self._spread
        self._at, self._normal, self._length = _rim(camera, q.radius)
        low = 1 / (4 * q.radius)
        edges = _distances(low, _FARTHEST / camera.panel.active_side, len(self._length))
        away, step = (edges[:, 1:] + edges[:, :-1]) / 2, np.diff(edges)
        area, rim = q.lens.stop.area * q.radius**2, self._length.sum()
        whole = math.pi * away * area**2 / rim
        each = np.where(away < low, whole, 1 / (4 * math.pi**2 * away**2)) * step
        self._away = np.concatenate([-away[:, ::-1], away], axis=1)
        density = np.concatenate([each[:, ::-1], each], axis=1)
        self._density = self._length[:, None] * density / len(self._window)

    @cached_property
    def _window(self) -> Array:
        return window_frequencies(self._q)

    @property
    def spread(self) -> float:
        return float(self._spread)

    @property
    def zone(self) -> float:
        """Cycles per metre that light takes to spread over a Fresnel zone on its way."""
        return 1 / math.sqrt(self._bend)

    @cached_property
    def reach(self) -> Array:
        """The largest frequency behind the lens that goes to the samples, along y and x."""
        q = self._q
        far = [float(q.samples.coordinates(axis).abs().max()) for axis in (0, 1)]
        return np.array(far) / q.scale

    def slope(self, at: Array) -> Array:
        """Cycles per metre by which the lens turns light at places (..., 2) in its plane."""
        q = self._q
        place = torch.from_numpy(at / q.radius).requires_grad_()
        phase = wave_phase(q.lens, q.from_lens, q.wavelength, place[..., 0], place[..., 1])
        if not phase.requires_grad:
            return np.zeros_like(at)
        (found,) = torch.autograd.grad(phase.sum(), place)
        return np.asarray(found.numpy() / (2 * math.pi * q.radius))

    def rays(self, at: Array, behind: Array) -> Rays:
        """Light that has the frequencies `behind` the lens, before the lens turns it there."""
        frequency = self._spread * behind
        start = at / self._spread - self._shift - self._bend * frequency
        sent = self._sent(frequency)
        return Rays(frequency, start, sent * self._lit(start), sent)

    def _sent(self, frequency: Array) -> Array:
        """A pixel's envelope sinc², and beyond its first zero the mean over its lobes."""
        turns = np.abs(frequency) * self._camera.panel.active_side
        lobes = 0.5 / (math.pi * np.maximum(turns, 1.0)) ** 2
        return np.asarray(np.prod(np.where(turns < 1, np.sinc(turns) ** 2, lobes), axis=-1))

    def _lit(self, start: Array) -> Array:
        """1 on the panel, and beside it what its own edges bend: at the distance x in the shadow
        of an edge, bend / (2 pi x)² (Fresnel's integrals, far from the edge)."""
        light = np.ones(start.shape[:-1])
        for axis in (0, 1):
            beside = self._beside(start[..., axis], axis)
            light *= np.minimum(1.0, self._bend / np.maximum((2 * math.pi * beside) ** 2, 1e-300))
        return light

    def _beside(self, place: Array, axis: int) -> Array:
        """Metres from the panel's nearest edge along an axis, 0 on the panel."""
        line = self._camera.panel.plane.coordinates(axis)
        half = self._camera.panel.pitch / 2
        below, above = float(line[0]) - half - place, place - float(line[-1]) - half
        return np.maximum(np.maximum(below, above), 0.0)

    def _on_panel(self, place: Array) -> NDArray[np.bool_]:
        return (self._beside(place[..., 0], 0) == 0) & (self._beside(place[..., 1], 1) == 0)

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        """Lowest and highest place (y, x) of the stop's opening, in radii: a hole may be small."""
        low, high = zip(*(extent(self._camera, axis) for axis in (0, 1)), strict=True)
        return np.array(low), np.array(high)

    @cached_property
    def _lines(self) -> tuple[Array, Array]:
        """Places along y and x across the stop's opening, metres."""
        low, high = self._box
        line = (np.arange(_SIDE) + 0.5) / _SIDE
        y, x = self._q.radius * (low + np.outer(line, high - low)).T
        return y, x

    @cached_property
    def _inside(self) -> NDArray[np.bool_]:
        """Which crossings of the lines are open."""
        y, x = np.meshgrid(*(line / self._q.radius for line in self._lines), indexing="ij")
        stop = self._q.lens.stop
        inside = np.asarray(stop.opening.contains(y, x))
        for shape in stop.obscurations:
            inside &= ~shape.contains(y, x)
        return inside

    @cached_property
    def _places(self) -> Array:
        """The open ones, (n, 2) for y and x."""
        y, x = np.meshgrid(*self._lines, indexing="ij")
        return np.stack([y[self._inside], x[self._inside]], axis=-1)

    @cached_property
    def _open(self) -> Rays:
        """Light that goes straight through the stop into the window, (places, window, 2)."""
        at = self._places
        return self.rays(at[:, None], self._window - self.slope(at)[:, None])

    @cached_property
    def straight(self) -> float:
        """Square metres of the stop from which the window is lit, each weighed by the light."""
        low, high = self._box
        each = float(np.prod(high - low)) * (self._q.radius / _SIDE) ** 2
        return float(self._open.light.mean(axis=1).sum()) * each

    @cached_property
    def passing(self) -> tuple[Array, Array]:
        """The lowest and highest frequencies (y, x) that go straight into the window's samples,
        from wherever the panel is lit; with room for a Fresnel zone, but not beyond all that go
        there from anywhere."""
        rays, room = self._open, self._spread * self.reach / 2
        lit = rays.light > _LIT * rays.light.max(initial=0.0)
        if not lit.any():
            return -room - self.zone, room + self.zone
        low, high = (end(rays.frequency[lit], axis=0) for end in (np.min, np.max))
        least, most = (end(rays.frequency, axis=(0, 1)) for end in (np.min, np.max))
        low, high = np.maximum(low - self.zone, least), np.minimum(high + self.zone, most)
        return np.asarray(low - room), np.asarray(high + room)

    @cached_property
    def speckles(self) -> float:
        """About how many of them a window has, behind an evenly lit panel."""
        q = self._q
        rows, columns = (k - 2 * q.margin for k in q.samples.shape)
        area = rows * columns * q.samples.pitch[0] * q.samples.pitch[1]
        return max(1.0, area * self.straight / q.scale**2)

    @property
    def share(self) -> float:
        """Of the point's light, what an evenly lit panel sends to a unit of frequency area."""
        return self.straight * self._camera.panel.active_side**2 / open_area(self._camera)

    @property
    def window_share(self) -> float:
        """Of an evenly lit panel's light, what goes into the window."""
        q = self._q
        rows, columns = (k - 2 * q.margin for k in q.samples.shape)
        area = rows * columns * q.samples.pitch[0] * q.samples.pitch[1]
        return self.share * area / q.scale**2

    @cached_property
    def _kernels(self) -> list[tuple[Array, Array]]:
        """Frequencies all over the band that passes, and how a pixel sends to them, so that the
        squares of what is sent add up to light; along each axis."""
        panel, found = self._camera.panel, []
        for axis in (0, 1):
            low, high = (float(end[axis]) for end in self.passing)
            f = np.linspace(low, high, 4 * panel.shape[axis])
            step = (high - low) / (f.size - 1)
            strength = np.sinc(f * panel.active_side) * math.sqrt(step * panel.active_side)
            found.append((f, strength))
        return found

    @cached_property
    def passing_share(self) -> float:
        """Of an evenly lit panel's light, what has frequencies that pass."""
        return float(np.prod([(strength**2).sum() for _, strength in self._kernels]))

    def inside(self, field: torch.Tensor) -> tuple[float, float]:
        """Brightness of a panel at frequencies that pass, over that of an evenly lit one.

        The least and the most in a batch; field: (..., rows, columns) of the panel.
        """
        power = field.real**2 + field.imag**2
        total = power.sum(dim=(-2, -1), dtype=torch.float64)
        inward = []
        for axis, (f, strength) in enumerate(self._kernels):
            turns = -torch.outer(torch.from_numpy(f), self._camera.panel.plane.coordinates(axis))
            kernel = unit_phasor(turns, torch.complex128) * torch.from_numpy(strength)[:, None]
            inward.append(kernel.to(field))
        straight = inward[0] @ field @ inward[1].mT
        light = (straight.real**2 + straight.imag**2).sum(dim=(-2, -1), dtype=torch.float64)
        found = light / total.clamp(min=1e-300) / self.passing_share
        return (float(found.min()), float(found.max())) if found.numel() else (1.0, 1.0)

    @cached_property
    def _accepted(self) -> Array:
        """Frequencies before the lens that the window accepts at the edge: (edge, window, 1, 2)."""
        return np.asarray(self._window - self.slope(self._at)[:, None])[:, :, None]

    @cached_property
    def scattered(self) -> Rays:
        """The light that the edge scatters into the window, (edge, window, distance, 2)."""
        rays = self.rays(self._at[:, None, None], self._accepted - self.across)
        weight = self._density[:, None]
        return Rays(rays.frequency, rays.start, rays.light * weight, rays.anywhere * weight)

    def turned_back(self, turned: Array, low: Array, high: Array, passed: Array) -> float:
        """Light of a band (low, high) that a grid's own frequency brings into the window.

        turned: cycles per metre (y, x) by which it arrives beside the window. passed: share of
        the field that the grid's edge passes, by its turn (edge, 1, distance). The window's
        middle stands for all of it.
        """
        behind = (self._accepted[:, 0] + turned - self.across[:, 0]).reshape(-1, 2)
        inside = np.flatnonzero(between(self._spread * behind, low, high))
        edge = inside // self.across.shape[2]
        light = self.rays(self._at[edge], behind[inside]).light
        weight = (self._density * len(self._window) * passed[:, 0] ** 2).ravel()
        return float(light @ weight[inside])

    @cached_property
    def across(self) -> Array:
        """By which frequency the edge turns the light: (edge, 1, distance, 2)."""
        return np.asarray(self._normal[:, None, None] * self._away[:, None, :, None])

    def relative(self, lost: float) -> float:
        """Relative L2 error of an intensity whose field lacks that much."""
        if not self.straight > 0:
            return math.inf
        return self._safe * self._averaged * math.sqrt(lost / self.straight)

    def allowed(self, error: float) -> float:
        """The light that may be lost for a relative L2 error of the intensity."""
        return (error / (self._safe * self._averaged)) ** 2 * self.straight

    @cached_property
    def _averaged(self) -> float:
        """What is left of a relative error when light is integrated over pixels.

        Light from two places that are g apart in frequency makes fringes, of which a pixel of
        side p keeps sinc²(g p) of the power. Of an evenly lit panel's light |U|², half of the
        power is its mean, and half are fringes of any two places in the stop; the error
        2 Re(U* e) is all fringes, of the stop's places with those of its edge (Goodman,
        Statistical Optics, §7.5, for either alone).
        """
        rim = self.scattered.light.sum(axis=(1, 2))
        if not (any(self._q.pixel) and self.straight > 0 and rim.any()):
            return 1.0
        beating = self._kept_fringes(self._at) @ rim / rim.sum()
        return math.sqrt(2 * float(beating) / self.contrast)

    @cached_property
    def contrast(self) -> float:
        """Mean square of an evenly lit panel's light in the window over the square of its mean:
        2 for samples of speckles, less for pixels that average them."""
        if not (any(self._q.pixel) and self.straight > 0):
            return 2.0
        light = self._open.light.mean(axis=1)
        return 1 + float(self._kept_fringes(self._places) @ light / light.sum())

    def _kept_fringes(self, at: Array) -> Array:
        """Share of their power that pixels keep, of fringes of all light in the stop with that
        of each place (n, 2) at the lens."""
        light = np.zeros(self._inside.shape)
        light[self._inside] = self._open.light.mean(axis=1)
        down, along = (
            np.sinc(np.subtract.outer(at[:, axis], self._lines[axis]) / self._q.scale * side) ** 2
            for axis, side in enumerate(self._q.pixel)
        )
        return np.asarray(((down @ light) * along).sum(axis=1) / light.sum())

    @property
    def _safe(self) -> float:
        return _SAFE + _FEW / math.sqrt(self.speckles)

    def of_share(self, share: float) -> float:
        """Relative L2 error of an intensity of whose light so large a share is wrong."""
        return self._safe * math.sqrt(share)

    @cached_property
    def _collapsing(self) -> tuple[float, float]:
        """Light that is wrong where the stop's shadow on the panel stands for the stop: of
        frequencies that pass, and of all.

        Light of the frequency f that the edge turns to g has run on by the phase
        pi bend (g² - f²) where the panel stands apart.
        """
        rays = self.scattered
        goes = self._spread * self._accepted
        turn = math.pi * self._bend * ((goes**2).sum(-1) - (rays.frequency**2).sum(-1))
        shadow = self._on_panel(self._at / self._spread - self._shift)[:, None, None]
        dark = self._sent(rays.frequency) * self._density[:, None]
        lit = (rays.light + np.where(shadow, dark, 0.0)) / 2
        lost = lit * (2 - 2 * np.cos(turn))
        return float(lost[between(rays.frequency, *self.passing)].sum()), float(lost.sum())

    def of_collapse(self) -> float:
        """What it costs to put the stop's shadow on the panel in place of the stop."""
        return self.relative(self._collapsing[1])

    @property
    def collapse_within(self) -> float:
        """Share of that error's square that light of frequencies that pass makes."""
        within, whole = self._collapsing
        return within / whole if whole > 0 else 0.0


def _distances(low: float, high: float, pieces: int) -> Array:
    """Ends of the steps in distance from an edge's own frequency, (pieces, steps + 1), cycles a
    metre; those nearer than `low` first.

    Every piece of the edge has other steps (by the golden ratio, so that neighbours' fill each
    other's gaps): where a band ends, or the panel, is told much finer than by a step.
    """
    high = max(high, 4 * low)
    shift = ((np.arange(pieces) + 0.5) * (math.sqrt(5) - 1) / 2) % 1
    number = np.arange(_STEPS + 1) + shift[:, None]
    far = low * (high / low) ** (number / _STEPS)
    near = np.broadcast_to(np.linspace(0, low, _NEAR + 1), (pieces, _NEAR + 1))
    return np.concatenate([near, far], axis=1)


def between(frequency: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Which frequencies (..., 2) are in a band; low, high: (2,) for y and x."""
    y, x = frequency[..., 0], frequency[..., 1]
    return np.asarray((y >= low[0]) & (y <= high[0]) & (x >= low[1]) & (x <= high[1]))


def window_frequencies(q: Question) -> Array:
    """Frequencies (y, x) behind the lens that go to places in the window, (places, 2)."""
    rows, columns = q.inner
    lines = (q.samples.coordinates(0)[rows], q.samples.coordinates(1)[columns])
    (y0, y1), (x0, x1) = ((float(line[0]), float(line[-1])) for line in lines)
    middle = np.array([y0 + y1, x0 + x1]) / 2
    half = np.array([y1 - y0, x1 - x0]) / 2
    corners = [[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]
    return np.asarray((middle + 2 * _CLEAR * half * np.array(corners)) / q.scale)


def _rim(camera: Camera, radius: float) -> tuple[Array, Array, Array]:
    """Places along the stop's boundary, its normals there, and lengths; metres."""
    pieces = [piece for loop in camera.lens.stop.loops for piece in loop.pieces]
    count = max(4, _RIM // len(pieces))
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
