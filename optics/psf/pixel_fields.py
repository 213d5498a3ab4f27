"""Compute the fields that single panel pixels send to places in the stop, and integrate along rows.

Pixels many Fresnel zones away have a short form. Rows are integrated in pieces, up to any end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera
from optics.gauss_legendre import gauss_legendre
from optics.propagation.fresnel_matrix import cell_kernel
from optics.psf.axes import fresnel_area
from optics.psf.request import PSFRequest
from optics.psf.split_phase import SplitPhase
from optics.psf.to_lens import TaperedBand


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
        self._tensor_area = torch.tensor(self._area, dtype=torch.float64)
        self._grow = n.radius / float(n.shadow_magnification)
        self._shifts = [float(slope) * n.separation for slope in n.chief_ray_slopes]
        self._lines = [camera.panel.plane.coordinates(axis) for axis in (0, 1)]

    def fields(self, axis: int, place: torch.Tensor, pixels: slice = slice(None)) -> torch.Tensor:
        """Return what pixels send to places along an axis, (places, pixels)."""
        arriving = place * self._grow - self._shifts[axis]
        line, side = self._lines[axis][pixels], self._panel.active_side
        near = self._pixels_within(line, arriving, self._near_distance)
        far = [
            torch.from_numpy(far_fields(arriving.numpy(), part.numpy(), side, self._area))
            for part in (line[: near.start], line[near.stop :])
        ]
        within = cell_kernel(arriving[:, None] - line[near], side, self._tensor_area)
        field = torch.cat([far[0], within, far[1]], dim=1)
        return self._tapered(axis, field, arriving, line)

    @property
    def _near_distance(self) -> float:
        """Metres between a pixel and a place within which its field is no far field."""
        return FAR_ZONES * math.sqrt(self._area) + self._panel.active_side

    @staticmethod
    def _pixels_within(line: torch.Tensor, arriving: torch.Tensor, distance: float) -> slice:
        """Return the pixels of a line that lie within a distance of any of the places."""
        first = int(torch.searchsorted(line, float(arriving.min()) - distance))
        return slice(first, int(torch.searchsorted(line, float(arriving.max()) + distance)))

    def _tapered(
        self, axis: int, field: torch.Tensor, arriving: torch.Tensor, line: torch.Tensor
    ) -> torch.Tensor:
        """Return the field without light that isn't followed, (places, pixels)."""
        if self._reach is None:
            return field
        band = self._reach[axis]
        room = band.taper_sigma * band.taper_sigmas
        low, high = (band.low + room) * self._area, (band.high - room) * self._area
        # Light of these pixels is followed to all places.
        first = int(torch.searchsorted(line, float(arriving.max()) - high))
        last = int(torch.searchsorted(line, float(arriving.min()) - low))
        parts = [slice(0, first), slice(max(first, last), len(line))]
        for part in parts:
            offset = arriving[:, None] - line[part]
            field[:, part] *= band.taper(offset / self._area)
        return field

    def path_turns(self, axis: int, place: torch.Tensor) -> torch.Tensor:
        """Return the phases of paths from pixels to places, in turns, (places, pixels)."""
        arriving = place * self._grow - self._shifts[axis]
        return (arriving[:, None] - self._lines[axis]) ** 2 / (2 * self._area)

    def reached(self, axis: int, place: torch.Tensor) -> slice:
        """Return the pixels whose light gets to any of the places."""
        low, high = self._farthest(axis)
        arriving = place * self._grow - self._shifts[axis]
        line = self._lines[axis]
        first = int(torch.searchsorted(line, float(arriving.min()) - high))
        return slice(first, max(first, int(torch.searchsorted(line, float(arriving.max()) - low))))

    def reached_count(self, axis: int, width: float) -> float:
        """Count the pixels whose light gets to places within a width in stop radii, about."""
        low, high = self._farthest(axis)
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
        low, high = self._farthest(axis)
        return (high - low) / self._grow

    def _farthest(self, axis: int) -> tuple[float, float]:
        """Return how far light is followed sideways, down and up an axis, in metres."""
        if self._reach is None:
            return -math.inf, math.inf
        low, high = self._reach[axis].outer_limits
        return low * self._area, high * self._area

    def steepest_slope(self, axis: int, span: tuple[float, float], lens: SplitPhase) -> float:
        """Bound the phase slope of the light in the stop, radians per stop radius.

        Light from a point of the panel, the lens, and the kernel of a sensor sample each add a
        slope that is linear in the places, so that the extremes lie at their ends.

        span: low and high end of the stop's opening.
        """
        n, grow, shift = self._n, self._grow, self._shifts[axis]
        half = self._panel.pitch / 2
        ends = float(self._lines[axis][0]) - half, float(self._lines[axis][-1]) + half
        seen = n.samples.coordinates(axis)
        low, high = self._farthest(axis)
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


Array = NDArray[np.float64]
Waves = NDArray[np.complex128]

FAR_ZONES = 6.0
"""Distance from a pixel's edge, in Fresnel zones, from which the series here holds to rounding."""

_BLOCK = 8192
"""Numbers in an array that stays in the processor's cache."""


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
    """Return the waves from pixel edges, without their phasors; see far_fields().

    place, edge: in units of sqrt(area).
    """
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


class PartialIntegrals:
    """Divides rows of the stop into pieces, whose nodes interpolate the integrand.

    In a piece, the values at Gauss-Legendre nodes determine a polynomial in Legendre's basis. Its
    integral up to any end is a sum over the nodes, whose weights depend on the end alone. Whole
    pieces to the left are summed with the usual weights.

    low, high: ends of the rows, in stop radii.
    slope: steepest phase slope of what is integrated, radians per stop radius.
    turn: half the phase change in a piece, radians.
    """

    def __init__(self, low: float, high: float, slope: float, turn: float) -> None:
        turns = (high - low) * slope / 2
        self.pieces = max(1, math.ceil(turns / turn))
        # exp(i t x) has Chebyshev coefficients J_k(t), which fall below 1e-15 from here on.
        each = turns / self.pieces
        self.nodes = math.ceil(each + 11 * each ** (1 / 3)) + 14
        self._low, self.width = low, (high - low) / self.pieces

    @property
    def node_count(self) -> int:
        return self.pieces * self.nodes

    @cached_property
    def weights(self) -> torch.Tensor:
        """The weights of the nodes of a whole piece, in stop radii."""
        return torch.from_numpy(gauss_legendre(self.nodes)[1] * (self.width / 2))

    def places(self, piece: int) -> torch.Tensor:
        """Return the nodes of a piece, in stop radii."""
        nodes = gauss_legendre(self.nodes)[0]
        return torch.from_numpy(self._low + self.width * (piece + (nodes + 1) / 2))

    def sort_ends(self, end: Array) -> SortedEnds:
        """Sort the ends of rows, in stop radii, into the pieces."""
        place = (end - self._low) / self.width
        piece = np.clip(place.astype(np.int64), 0, self.pieces - 1)
        inside = np.clip(2 * (place - piece) - 1, -1, 1)
        order = np.argsort(piece, kind="stable")
        starts = np.searchsorted(piece[order], np.arange(self.pieces + 1))
        return SortedEnds(self, inside, order, starts)

    def partial_weights(self, inside: Array) -> torch.Tensor:
        """Return each end's weights in its piece, (ends, nodes).

        inside: the ends, from -1 to 1 over the piece.
        """
        values = np.empty((self.nodes + 1, inside.size))
        values[0], values[1] = 1.0, inside
        for k in range(1, self.nodes):
            # Bonnet's recurrence
            np.multiply(values[k], inside, out=values[k + 1])
            values[k + 1] *= (2 * k + 1) / k
            values[k + 1] -= values[k - 1]
            values[k + 1] *= k / (k + 1)
        degree = np.arange(1, self.nodes)[:, None]
        integrals = np.empty((self.nodes, inside.size))
        integrals[0] = inside + 1
        np.subtract(values[2:], values[:-2], out=integrals[1:])
        integrals[1:] /= 2 * degree + 1
        return torch.from_numpy(integrals.T @ self._coefficients * (self.width / 2))

    @cached_property
    def _coefficients(self) -> Array:
        """Legendre coefficients of the interpolating polynomial, from values at the nodes."""
        nodes, weights = gauss_legendre(self.nodes)
        degree = np.arange(self.nodes)[:, None] + 0.5
        polynomials = np.polynomial.legendre.legvander(nodes, self.nodes - 1).T
        return np.asarray(degree * weights * polynomials)


@dataclass(frozen=True)
class SortedEnds:
    """Holds the ends of rows, sorted into the pieces of PartialIntegrals.

    inside: each end's place in its piece, -1 to 1.
    order: numbers of the ends, piece by piece.
    starts: where each piece's ends begin in that order.
    """

    integrals: PartialIntegrals
    inside: Array
    order: NDArray[np.int64]
    starts: NDArray[np.int64]

    def in_piece(self, piece: int, most: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yield the ends in a piece, `most` at a time, and each one's weights, (ends, nodes)."""
        for start in range(self.starts[piece], self.starts[piece + 1], most):
            ends = self.order[start : min(start + most, self.starts[piece + 1])]
            yield torch.from_numpy(ends), self.integrals.partial_weights(self.inside[ends])
