"""The camera's chain by direct quadrature: the slow judge of the fast engines behind a panel
that stands apart from its lens.

It shares no code with them, and takes none of their short cuts. Thesis Eq. 5.1 to 5.7 stand as
written, with their slips corrected: a point's wave over the panel, pixels of one modulation
each, Fresnel's integral to the lens, stop, lens and aberrations, and Fresnel's integral again
to the sensor. The first is that of panel.py. The second is a sum over lines across the stop. Along
a line the nodes stand in cells that all lines share; where a line is open in a part of a cell,
the wave between its nodes is that of the polynomial through them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.polynomial import chebyshev, legendre
from numpy.typing import NDArray
from scipy.special import roots_legendre

from labapp.accuracy.references.coverage import open_area_shares
from labapp.accuracy.references.lens_integral import (
    StopLine,
    pupil_phase,
    steepest_phase_slope,
    stop_lines,
)
from labapp.accuracy.references.panel_integral import (
    ImagingChain,
    LowRankModulations,
    ParabolicWavePixels,
    SphericalWavePixels,
)

Array = NDArray[np.float64]
Field = NDArray[np.complex128]

_MARGIN = 1.3
_CELL = 16.0
"""Radians by which an integrand turns over half a cell, at the most."""

NODES = 34
"""In a cell: a polynomial of this many terms follows exp(i w t) to (e w / 68)^34."""

_REACH_MARGIN = 1e-9
"""Of the stop's reach, by which the cells go beyond it."""

_LINES = 32
"""That are summed at a time."""

_PIECE = 2048
"""Places at the lens that are looked at from all pixels at a time."""

_MOST_SUMS = 2e7
"""Complex numbers that are held of sums over cells."""

_DEGREE = 40
"""Of the polynomials that follow aberrations, and a stigmatic lens, along a line."""


def chain_density(
    chain: ImagingChain,
    modulations: Sequence[Field],
    y: Array,
    x: Array,
    *,
    margin: float = _MARGIN,
) -> Array:
    """Share of a point's light per square metre, at heights y and places x around its image,
    (modulations, y, x).

    modulations: of the panel's pixels. y, x: metres from the geometric image. The share is of
    what panel and stop would pass if they stood in one plane, for a point on the axis.
    margin: by how much more densely than is needed nodes stand.
    """
    field = chain_field(chain, modulations, y, x, margin=margin)
    panel = chain.camera.panel
    passed = open_area_shares(chain.lens.stop, chain.radius, panel.plane)
    power = float(passed.sum()) * panel.active_side**2
    return np.asarray(np.abs(field) ** 2 / power)


def chain_field(
    chain: ImagingChain,
    modulations: Sequence[Field],
    y: Array,
    x: Array,
    *,
    margin: float = _MARGIN,
) -> Field:
    """The wave at the sensor, for one of amplitude 1 on the panel; arguments as above."""
    y, x = y + chain.field[0], x + chain.field[1]
    down, across = (margin * slope for slope in _slopes(chain, y, x))
    line_sum = _LineSum(chain, modulations, x, across)
    found = np.zeros((len(modulations), y.size, x.size), dtype=np.complex128)
    lines = stop_lines(chain.lens.stop, math.hypot(down, across))
    while batch := list(islice(lines, _LINES)):
        heights = np.array([line.height for line in batch]) * chain.radius
        weights = np.array([line.weight for line in batch])
        found += (_sensor_kernel(chain, y, heights) * weights) @ line_sum(batch)
    return found * chain.radius**2


def line_and_node_counts(chain: ImagingChain, y: Array, x: Array) -> tuple[float, float]:
    """About how many lines the stop takes, and how many nodes a line."""
    down, across = (_MARGIN * slope for slope in _slopes(chain, y, x))
    cells = math.ceil(across * chain.stop_extent / chain.radius / _CELL)
    return math.hypot(down, across) * np.pi / 4 + 40, cells * NODES


def _slopes(chain: ImagingChain, y: Array, x: Array) -> tuple[float, float]:
    """The most radians by which the integrand in the lens' plane turns in a stop radius, along
    y and x: light from the pixels' edges, and light that goes straight on."""
    lens, wavelength, z1 = chain.lens, chain.wavelength, chain.camera.separation
    # An edge's light begins to turn within a Fresnel zone of its shadow.
    rest = 4 * chain.radius / math.sqrt(wavelength * z1)
    if lens.aberrations:
        rest += 1.1 * steepest_phase_slope(lens, lens.focus_distance, wavelength)
    if lens.kind == "stigmatic":
        rest += 1.1 * steepest_phase_slope(lens, chain.distance + z1, wavelength)
    slopes = []
    for axis, seen in ((0, y), (1, x)):
        ends = chain.edges(axis).min(), chain.edges(axis).max()
        straight = chain.field[axis] / lens.image_distance
        rates = [
            wave - place / lens.focus_distance - one / lens.image_distance
            for place in (-chain.stop_extent, chain.stop_extent)
            for one in (seen.min(), seen.max())
            for wave in (
                *((place - end) / z1 for end in ends),
                place / (chain.distance + z1) + straight,
            )
        ]
        turn = 2 * math.pi / wavelength * max(map(abs, rates))
        slopes.append(turn * chain.radius + rest)
    return slopes[0], slopes[1]


def _sensor_kernel(chain: ImagingChain, positions: Array, places: Array) -> Field:
    """Lens and Fresnel's integral to the sensor along one axis, (seen, places); metres."""
    lens, wavelength, z2 = chain.lens, chain.wavelength, chain.lens.image_distance
    path = (positions[:, None] - places) ** 2 / z2 - places**2 / lens.focal_length
    return np.asarray(np.exp(1j * np.pi / wavelength * path) / np.sqrt(1j * wavelength * z2))


class _LineSum:
    """The integral along lines across the stop, to all places x on the sensor."""

    def __init__(
        self, chain: ImagingChain, modulations: Sequence[Field], x: Array, slope: float
    ) -> None:
        self._chain, self._x = chain, x
        self._panel = SphericalWavePixels(chain) if chain.sphere else ParabolicWavePixels(chain)
        self._factors = LowRankModulations([self._panel.source_field(one) for one in modulations])
        # A little beyond the stop: a line's end that rounding moves out is still in a cell.
        reach = chain.stop_extent / chain.radius * (1 + _REACH_MARGIN)
        self._edges = np.linspace(-reach, reach, max(1, math.ceil(slope * reach / _CELL)) + 1)
        self._t, self._w = roots_legendre(NODES)
        self._half = (self._edges[1] - self._edges[0]) / 2
        middles = self._edges[:-1, None] + self._half
        self._nodes = (middles + self._half * self._t).ravel()
        weights = np.tile(self._half * self._w, middles.size)
        self._panel_field = self._field_from_panel()
        self._sensor_kernels = (_sensor_kernel(chain, x, self._nodes * chain.radius) * weights).T
        self._sums = self._cumulative_sums() if chain.lens.has_quadratic_phase else None
        # From values at the nodes of a cell to a polynomial through them.
        degrees = np.arange(NODES)[:, None] + 0.5
        self._fit = degrees * legendre.legvander(self._t, NODES - 1).T * self._w

    def _field_from_panel(self) -> Field:
        """What the panel's columns send to the nodes, (nodes, ranks); a piece at a time, as
        there are many of both."""
        places = self._nodes * self._chain.radius
        pieces = np.array_split(places, math.ceil(places.size / _PIECE))
        found = [
            self._factors.apply_right_factors(self._panel.propagation_matrix(1, piece))
            for piece in pieces
        ]
        return np.concatenate(found)

    def _cumulative_sums(self) -> Field | None:
        """Sums over all cells up to an edge, (edges, ranks, x): where the lens is a product along
        y and x, all lines share them. None if they are too many to hold."""
        cells, ranks, places = self._edges.size - 1, self._panel_field.shape[1], self._x.size
        if cells * ranks * places > _MOST_SUMS:
            return None
        seen = self._panel_field.reshape(cells, NODES, ranks).swapaxes(1, 2)
        each = seen @ self._sensor_kernels.reshape(cells, NODES, places)
        return np.concatenate([np.zeros_like(each[:1]), np.cumsum(each, axis=0)])

    def __call__(self, lines: list[StopLine]) -> Field:
        """(modulations, lines, x)."""
        heights = np.array([line.height for line in lines])
        rows = self._panel.propagation_matrix(0, heights * self._chain.radius) @ self._factors.left
        bent = self._phase_coefficients(heights)
        if self._sums is None:
            found = self._node_by_node(lines, rows, bent)
        else:
            found = self._cell_by_cell(lines, rows, self._sums)
        number, cell, ends = self._partial_cell_weights(lines, bent)
        cells = self._panel_field.reshape(-1, NODES, self._panel_field.shape[1])
        for one, part in zip(found, self._factors.parts, strict=True):
            for n, c, end in zip(number, cell, ends, strict=True):
                one[n] += end @ (cells[c, :, part] @ rows[n, part])
        return found

    def _node_by_node(
        self, lines: list[StopLine], rows: Field, coefficients: Array | None
    ) -> Field:
        whole = np.stack([self._open_cell_nodes(line) for line in lines])
        passed = np.where(whole, self._lens_factor(coefficients, self._nodes), 0)
        parts = self._factors.parts
        waves = ((rows[:, part] @ self._panel_field[:, part].T) * passed for part in parts)
        return np.stack([wave @ self._sensor_kernels for wave in waves])

    def _cell_by_cell(self, lines: list[StopLine], rows: Field, sums: Field) -> Field:
        parts = self._factors.parts
        found = np.zeros((len(parts), len(lines), self._x.size), dtype=np.complex128)
        for number, line in enumerate(lines):
            for low, high in line.open:
                first, last = self._whole_cells(low, high)
                if last > first:
                    inside = sums[last] - sums[first]
                    for one, part in zip(found, parts, strict=True):
                        one[number] += rows[number, part] @ inside[part]
        return found

    def _whole_cells(self, low: float, high: float) -> tuple[int, int]:
        """The first and the last edge of a cell that lie in an open piece of a line."""
        first = np.searchsorted(self._edges, low)
        return int(first), int(np.searchsorted(self._edges, high, side="right")) - 1

    def _open_cell_nodes(self, line: StopLine) -> NDArray[np.bool_]:
        """The nodes of cells that are open all over."""
        found = np.zeros(self._nodes.size, dtype=bool)
        for low, high in line.open:
            first, last = self._whole_cells(low, high)
            found[first * NODES : max(first, last) * NODES] = True
        return found

    def _partial_cells(self, line: StopLine) -> Iterator[tuple[int, float, float]]:
        """What whole cells leave of a line's open pieces: the cell's number, and from where to
        where."""
        for low, high in line.open:
            first, last = self._whole_cells(low, high)
            if last < first:
                yield last, low, high
                continue
            if low < self._edges[first]:
                yield first - 1, low, float(self._edges[first])
            if high > self._edges[last] and last < self._edges.size - 1:
                yield last, float(self._edges[last]), high

    def _partial_cell_weights(
        self, lines: list[StopLine], coefficients: Array | None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Field]:
        """For every piece: its line, its cell, and its weights on the wave at the cell's nodes,
        (pieces, x, nodes): between them the wave is the polynomial that goes through them."""
        pieces = [
            (n, *piece) for n, line in enumerate(lines) for piece in self._partial_cells(line)
        ]
        nothing = (0, 0, self._edges[0], self._edges[0])
        columns = zip(*(pieces or [nothing]), strict=True)
        number, cell, low, high = (np.array(column) for column in columns)
        half = (high - low)[:, None] / 2
        nodes = low[:, None] + half * (1 + self._t)
        inside = (nodes - self._edges[cell][:, None]) / self._half - 1
        between = legendre.legvander(inside, NODES - 1) @ self._fit
        onward = _sensor_kernel(self._chain, self._x, nodes.ravel() * self._chain.radius)
        onward = onward.reshape(-1, *nodes.shape).swapaxes(0, 1)
        passed = (
            half
            * self._w
            * self._lens_factor(None if coefficients is None else coefficients[:, number], nodes)
        )
        return number, cell, (onward * passed[:, None]) @ between

    def _phase_coefficients(self, heights: Array) -> Array | None:
        """Phases of aberrations, and what a stigmatic lens adds to the parabolas of a thin one.

        Along a line they are polynomials, or as good as that: their coefficients, line by line.
        """
        chain, lens = self._chain, self._chain.lens
        if lens.has_quadratic_phase:
            return None
        whole = chain.distance + chain.camera.separation
        some = self._edges[-1] * chebyshev.chebpts1(_DEGREE + 1)
        phases = [pupil_phase(lens, whole, chain.wavelength, float(h), some) for h in heights]
        r2 = (heights[:, None] ** 2 + some**2) * chain.radius**2
        thin = np.pi / chain.wavelength * (1 / whole - 1 / lens.focus_distance) * r2
        return np.linalg.solve(self._vander(some), (np.stack(phases) - thin).T)

    def _vander(self, nodes: Array) -> Array:
        return np.asarray(chebyshev.chebvander(nodes / self._edges[-1], _DEGREE))

    def _lens_factor(self, coefficients: Array | None, nodes: Array) -> Field | Array:
        """What the lens multiplies the wave by besides its parabola, (lines, nodes); nodes may
        be those of each line."""
        if coefficients is None:
            return np.ones((1, nodes.shape[-1]))
        return np.asarray(np.exp(1j * (self._vander(nodes) @ coefficients.T[..., None])[..., 0]))
