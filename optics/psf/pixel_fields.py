"""Compute the fields that single panel pixels send to places in the stop, and the lens' wave there.

Pixels many Fresnel zones away have a short form. The lens' wave is a parabola and a short sum of
products of functions of y and of x.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import ToleranceError
from optics.camera import Camera
from optics.camera.pupil import defocus_curvature, defocus_path, vergence_error
from optics.propagation.fresnel_matrix import cell_kernel
from optics.psf.edge_scatter import fresnel_area
from optics.psf.request import PSFRequest
from optics.psf.to_lens import TaperedBand
from optics.zernike import zernike

Array = NDArray[np.float64]
Waves = NDArray[np.complex128]

FAR_ZONES = 6.0
"""Distance from a pixel's edge, in Fresnel zones, from which the series here holds to rounding."""

_BLOCK = 8192  # numbers in an array that stays in the processor's cache
_NODES = (24, 48, 96, 192, 384)  # Chebyshev nodes per axis that are tried for a lens' phase
_LEAST = 1e-15  # share of the strongest term below which terms are rounding errors
_TAIL = 1e-12  # coefficient of the highest orders below which an expansion counts as complete

# Samples per axis for the slope of a phase, and a factor, because it might be steeper between.
_SAMPLES, _MARGIN = 33, 1.2

# Terms that a phase takes, and further ones for its largest value; fitted to random lenses.
_TERMS, _TERMS_PER_RADIAN = 6, 0.55


class PixelFields:
    """Computes the field of panel pixels in the stop, a product of factors in y and x.

    The factors are Fresnel integrals in closed form (see `cell_kernel`). Places in the stop are in
    stop radii.

    n, camera: what is asked, in plain numbers.
    reach: bands (y, x) of frequencies whose light is followed, and which say how far a pixel's
    light goes sideways; None for all light.
    """

    def __init__(
        self, n: PSFRequest, camera: Camera, reach: Sequence[TaperedBand] | None = None
    ) -> None:
        self._n, self._panel, self._reach = n, camera.panel, reach
        self._area = fresnel_area(n)
        self._grow = n.radius / float(n.shadow_magnification)
        self._shifts = [float(slope) * n.separation for slope in n.chief_ray_slopes]
        self._lines = [camera.panel.plane.coordinates(axis) for axis in (0, 1)]
        self._near_distance = FAR_ZONES * math.sqrt(self._area) + self._panel.active_side
        """Metres between a pixel and a place within which its field is no far field."""
        self._farthest = [(-math.inf, math.inf)] * 2
        """How far light is followed sideways, down and up each axis, in metres."""
        if reach is not None:
            limits = [band.outer_limits for band in reach]
            self._farthest = [(low * self._area, high * self._area) for low, high in limits]

    def fields(self, axis: int, place: torch.Tensor, pixels: slice = slice(None)) -> torch.Tensor:
        """Return what pixels send to places along an axis, (places, pixels)."""
        arriving = place * self._grow - self._shifts[axis]
        line, side, room = self._lines[axis][pixels], self._panel.active_side, self._near_distance
        first, last = float(arriving.min()), float(arriving.max())
        near = _pixels_between(line, first - room, last + room)
        far = [
            torch.from_numpy(far_fields(arriving.numpy(), part.numpy(), side, self._area))
            for part in (line[: near.start], line[near.stop :])
        ]
        area = torch.tensor(self._area, dtype=torch.float64)
        within = cell_kernel(arriving[:, None] - line[near], side, area)
        field = torch.cat([far[0], within, far[1]], dim=1)
        if self._reach is not None:
            # Light of all pixels but those of `whole` is followed to some of the places only.
            band = self._reach[axis]
            room = band.taper_sigma * band.taper_sigmas
            low, high = (band.low + room) * self._area, (band.high - room) * self._area
            whole = _pixels_between(line, last - high, first - low)
            for part in (slice(0, whole.start), slice(whole.stop, len(line))):
                offset = arriving[:, None] - line[part]
                field[:, part] *= band.taper(offset / self._area)
        return field

    def path_turns(self, axis: int, place: torch.Tensor) -> torch.Tensor:
        """Return the phases of paths from pixels to places, in turns, (places, pixels)."""
        arriving = place * self._grow - self._shifts[axis]
        return (arriving[:, None] - self._lines[axis]) ** 2 / (2 * self._area)

    def reached(self, axis: int, place: torch.Tensor) -> slice:
        """Return the pixels whose light gets to any of the places."""
        low, high = self._farthest[axis]
        arriving = place * self._grow - self._shifts[axis]
        ends = float(arriving.min()) - high, float(arriving.max()) - low
        return _pixels_between(self._lines[axis], *ends)

    def reached_count(self, axis: int, width: float) -> float:
        """Count the pixels whose light gets to places within a width in stop radii, about."""
        low, high = self._farthest[axis]
        within = (high - low + width * self._grow) / self._panel.pitch + 1
        return min(float(self._panel.shape[axis]), within)

    def near_count(self, axis: int, width: float) -> float:
        """Count the pixels that lie near to places within a width in stop radii, about."""
        within = (2 * self._near_distance + width * self._grow) / self._panel.pitch + 1
        return min(within, self.reached_count(axis, width))

    @property
    def near_width(self) -> float:
        """How wide a neighbourhood of a place takes exact fields, in stop radii."""
        return 2 * self._near_distance / self._grow

    def reached_width(self, axis: int) -> float:
        """Return how wide the light of a point of the panel gets, in stop radii, maybe infinite."""
        low, high = self._farthest[axis]
        return (high - low) / self._grow

    def steepest_slope(self, axis: int, lens: SplitPhase) -> float:
        """Bound the phase slope of the light in the stop, radians per stop radius.

        Light from a point of the panel, the lens, and the kernel of a sensor sample each add a
        slope that is linear in the places, so that the extremes lie at their ends.
        """
        n, grow, shift, span = self._n, self._grow, self._shifts[axis], lens.spans[axis]
        half = self._panel.pitch / 2
        ends = float(self._lines[axis][0]) - half, float(self._lines[axis][-1]) + half
        seen = n.samples.coordinates(axis)
        low, high = self._farthest[axis]
        # At these places, light from an end of the panel has gone as far as it is followed.
        turns = [(end + way + shift) / grow for end in ends for way in (low, high)]
        places = [*span, *(min(max(turn, span[0]), span[1]) for turn in turns)]
        slopes = [
            2 * math.pi * grow * min(max(grow * place - shift - end, low), high) / self._area
            + 2 * lens.curvature * place
            - 2 * math.pi * n.radius * sample / n.scale
            for place in places
            for end in ends
            for sample in (float(seen.min()), float(seen.max()))
        ]
        return max(map(abs, slopes)) + lens.slope


def _pixels_between(line: torch.Tensor, low: float, high: float) -> slice:
    """Return the pixels of a line from `low` to `high`, in metres."""
    first = int(torch.searchsorted(line, low))
    return slice(first, max(first, int(torch.searchsorted(line, high))))


def far_fields(place: Array, line: Array, side: float, area: float) -> Waves:
    """Return the fields along an axis that far pixels send to places, (places, pixels).

    They are those of `cell_kernel`, as the difference of the waves from both edges of a pixel. At a
    distance t from an edge, in units of sqrt(area), its wave is

        exp(i pi t²) / (2 pi t) (i + v - 3 i v² - 15 v³ + ...),  v = 1 / (2 pi t²)

    (Abramowitz and Stegun 7.3.27 and 7.3.28), over sqrt(i). With x0 the middle of the places and s0
    a pixel near to it, the phase (x - s)² is (x0 - s)² + 2 (x - x0) (x0 - s0) + (x - x0)² and 2 (x
    - x0) (s0 - s); only the last one isn't a sum of functions of x and of s, and pixels are evenly
    spaced, so a product of two phasors has it. No large phases are subtracted.

    place: metres, (places,).
    line: evenly spaced centres of pixels, metres, all at least FAR_ZONES plus half a pixel away, on
    one side or on both.
    side: of a pixel, metres.
    area: Fresnel area in m².
    """
    found = np.empty((len(place), len(line)), dtype=np.complex128)
    if not found.size:
        return found
    unit = math.sqrt(area)
    place, line, half = place / unit, line / unit, side / unit / 2
    middle = (place.min() + place.max()) / 2
    aside = place - middle
    near = line[np.abs(line - middle).argmin()]
    # A table of phasors has all steps for some pixels, and a coarse one has the rest.
    steps = math.ceil(math.sqrt(len(line)))
    fine = _phasor(2 * aside[:, None] * (line[0] - line[:steps]))
    coarse = _phasor(2 * aside[:, None] * (near - line[::steps]))
    edges = (half, -half)
    down = [_phasor(aside**2 + 2 * aside * (middle - near - edge))[:, None] for edge in edges]
    along = [_phasor((middle - line - edge) ** 2 - 0.25) for edge in edges]
    some = max(1, _BLOCK // len(place) // steps)
    for start in range(0, coarse.shape[1], some):
        both = coarse[:, start : start + some, None] * fine[:, None, :]
        part = slice(start * steps, (start + some) * steps)
        columns = line[part]
        shared = both.reshape(len(place), -1)[:, : len(columns)]
        first, second = (
            _edge_waves(place, columns + edge) * along[k][part] * down[k]
            for k, edge in enumerate(edges)
        )
        np.multiply(shared, first - second, out=found[:, part])
    return found


def _phasor(half_turns: Array) -> Waves:
    angle = math.pi * (half_turns - 2 * np.round(half_turns / 2))
    return np.asarray(np.cos(angle) + 1j * np.sin(angle))


def _edge_waves(place: Array, edge: Array) -> Waves:
    """Return the waves from pixel edges, in Fresnel zones, without their phasors."""
    inverse = 1 / (2 * math.pi * np.subtract.outer(place, edge))
    v = 2 * math.pi * inverse * inverse
    square = v * v
    # Double factorials 1, 1, 3, 15, 105, ... with the signs of powers of -1 for either part.
    factors = [1]
    nearest = float(v.max())
    while factors[-1] * nearest ** (len(factors) - 1) > 1e-17 and len(factors) < 40:
        factors.append(factors[-1] * (2 * len(factors) - 1))
    signed = [factor * (-1) ** (k // 2) for k, factor in enumerate(factors)]
    wave = np.empty(inverse.shape, dtype=np.complex128)
    np.multiply(_polynomial(signed[::2], square), inverse, out=wave.imag)
    v *= inverse
    np.multiply(_polynomial(signed[1::2], square), v, out=wave.real)
    return wave


def _polynomial(factors: list[int], at: Array) -> Array:
    total = np.full_like(at, factors[-1])
    for factor in factors[-2::-1]:
        total *= at
        total += factor
    return total


class SplitPhase:
    """Holds a lens' wave exp(i phase), split between y and x.

    With the parabola's curvature c in radians per square stop radius, the wave is exp(i c (y² +
    x²)) times the sum over k of g_k(y) h_k(x). The smooth remainder of aberrations, and of a
    stigmatic lens, has few terms to double precision. They are predicted when the split is planned,
    and found at its first use.

    spans: low and high (y, x) of the stop's opening, in stop radii.
    curvature: c.
    terms: their number, predicted.
    slope: the steepest slope of the remainder's phase, radians per stop radius.
    """

    def __init__(self, n: PSFRequest) -> None:
        low, high = n.lens.stop.opening.extent
        self._n, self.spans = n, ((low[0], high[0]), (low[1], high[1]))
        curvature = defocus_curvature(n.lens, n.object_to_lens_distance, n.wavelength)
        self.curvature, self.terms, self.slope = curvature * n.radius**2, 1, 0.0
        if n.lens.has_quadratic_phase:
            return
        y, x = (torch.linspace(*span, _SAMPLES, dtype=torch.float64) for span in self.spans)
        phase = _remaining_phase(n, y[:, None], x[None, :]).expand(_SAMPLES, _SAMPLES)
        down, along = (
            float(phase.diff(dim=axis).abs().max() / (place[1] - place[0]))
            for axis, place in enumerate((y, x))
        )
        self.slope = _MARGIN * max(down, along)
        self.terms = _TERMS + math.ceil(_TERMS_PER_RADIAN * float(phase.max() - phase.min()))

    def prepare(self) -> None:
        """Find the terms; raise ToleranceError for aberrations of too many waves."""
        if not self._n.lens.has_quadratic_phase:
            self.terms = self._factors[0].shape[1]

    def along(self, axis: int, place: torch.Tensor) -> torch.Tensor:
        """Return g for axis 0, or h for 1, with the parabola's phase, at places, (n, terms)."""
        angle = torch.remainder(self.curvature * place**2, 2 * math.pi)
        wave = torch.polar(torch.ones_like(angle), angle)[:, None]
        if self._n.lens.has_quadratic_phase:
            return wave
        coefficients = self._factors[axis]
        low, high = self.spans[axis]
        t = ((2 * place - low - high) / (high - low)).clamp(-1, 1)
        order = torch.arange(coefficients.shape[0], dtype=torch.float64)
        polynomials = torch.cos(torch.acos(t)[:, None] * order).to(coefficients)
        return wave * (polynomials @ coefficients)

    @cached_property
    def _factors(self) -> tuple[torch.Tensor, torch.Tensor]:
        """The Chebyshev coefficients of all terms, (orders, terms), for y and x."""
        for nodes in _NODES:
            found = self._expansion(nodes)
            last = nodes * 3 // 4
            if max(float(found[last:].abs().max()), float(found[:, last:].abs().max())) <= _TAIL:
                left, strength, right = torch.linalg.svd(found)
                kept = int((strength > _LEAST * strength[0]).sum())
                return left[:, :kept] * strength[:kept].to(left), right[:kept].mT
        raise ToleranceError(
            "the lens' aberrations turn too fast to be split between the axes of its stop"
        )

    def _expansion(self, nodes: int) -> torch.Tensor:
        """Expand the wave, without its parabola, in Chebyshev polynomials."""
        angle = math.pi * (torch.arange(nodes, dtype=torch.float64) + 0.5) / nodes
        y, x = ((low + high) / 2 + (high - low) / 2 * torch.cos(angle) for low, high in self.spans)
        phase = _remaining_phase(self._n, y[:, None], x[None, :]).expand(nodes, nodes)
        order = torch.arange(nodes, dtype=torch.float64)
        weight = (2 - (order == 0).to(order)) / nodes
        there = (torch.cos(order[:, None] * angle) * weight[:, None]).to(torch.complex128)
        return there @ torch.polar(torch.ones_like(phase), phase) @ there.mT


def _remaining_phase(n: PSFRequest, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Return the phase of the lens beside its parabola, in radians; y, x in stop radii."""
    lens, distance = n.lens, n.object_to_lens_distance
    path = torch.zeros((), dtype=torch.float64)
    if lens.kind != "thin":
        r2 = (y**2 + x**2) * n.radius**2
        path = defocus_path(lens, distance, r2) - vergence_error(lens, distance) / 2 * r2
    for order, cycles, strength in lens.aberrations:
        path = path + strength * zernike(order, cycles, y, x)
    return 2 * math.pi / n.wavelength * path
