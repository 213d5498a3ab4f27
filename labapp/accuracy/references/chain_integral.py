"""The light on the sensor behind a panel apart from its lens, by direct quadrature.

This is the slow reference of the fast chain engines. It shares no code with them and none of
their approximations. It follows thesis Eq. 5.1 to 5.7, with their slips corrected: a point's wave
over the panel, pixels of one modulation each, the Fresnel integral to the lens, stop, lens and
aberrations, and the Fresnel integral to the sensor. `panel_integral` computes the first integral.
The second is a sum over lines across the stop. Along a line the nodes lie in cells that all lines
share. Where a line is open in only a part of a cell, the wave between the nodes of the cell is
interpolated by the polynomial through them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.polynomial import chebyshev, legendre
from numpy.typing import NDArray
from scipy.special import roots_legendre

from labapp.accuracy.references.lens_integral import (
    NODE_MARGIN,
    StopLine,
    open_area_shares,
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


_CELL_PHASE = 16.0
"""Most radians by which the phase of the integrand changes over half a cell; chosen."""

NODES_PER_CELL = 34
"""A polynomial of 34 terms approximates exp(i w t) to (e w / 68)^34."""

_REACH_MARGIN = 1e-9
"""Share of the stop's extent by which the cells reach beyond it, so that the end of a line lies in
a cell even where rounding moves it outwards; chosen."""

_LINES_AT_ONCE, _PLACES_AT_ONCE = 32, 2048
"""Lines across the stop that are summed at a time, and positions at the lens for which the light of
all pixels is computed at a time; chosen."""

_MAX_SUMS = 2e7
"""Most complex numbers of cumulative sums over cells that are kept in memory; chosen."""

_PHASE_DEGREE = 40
"""Degree of the polynomials that approximate the phase of aberrations, and of a stigmatic lens,
along a line; chosen."""


def chain_density(
    chain: ImagingChain,
    modulations: Sequence[Field],
    y: Array,
    x: Array,
    *,
    margin: float = NODE_MARGIN,
) -> Array:
    """Return the share of light per square metre, (modulations, y, x), 1/m².

    It is relative to the light that panel and stop would pass if they stood in one plane, for a
    point on the axis. Modulations of the pixels are complex, each (rows, columns); y and x are
    metres from the geometric image. `margin` is the factor by which nodes are denser than needed.
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
    margin: float = NODE_MARGIN,
) -> Field:
    """Return the complex field at the sensor, (modulations, y, x), as `chain_density` is asked.

    The wave on the panel has an amplitude of 1.
    """
    y, x = y + chain.field[0], x + chain.field[1]
    down, across = (margin * slope for slope in _slopes(chain, y, x))
    line_sum = _LineSum(chain, modulations, x, across)
    found = np.zeros((len(modulations), y.size, x.size), dtype=np.complex128)
    lines = stop_lines(chain.lens.stop, math.hypot(down, across))
    while batch := list(islice(lines, _LINES_AT_ONCE)):
        heights = np.array([line.height for line in batch]) * chain.radius
        weights = np.array([line.weight for line in batch])
        found += (_sensor_kernel(chain, y, heights) * weights) @ line_sum(batch)
    return found * chain.radius**2


def line_and_node_counts(chain: ImagingChain, y: Array, x: Array) -> tuple[float, float]:
    """Estimate how many lines across the stop, and nodes on each line, are summed."""
    down, across = (NODE_MARGIN * slope for slope in _slopes(chain, y, x))
    cells = math.ceil(across * chain.stop_extent / chain.radius / _CELL_PHASE)
    return math.hypot(down, across) * np.pi / 4 + 40, cells * NODES_PER_CELL


def _slopes(chain: ImagingChain, y: Array, x: Array) -> tuple[float, float]:
    """Estimate the integrand's largest phase slopes (y, x) at the lens, in radians per stop radius.

    They include the light from the edges of the pixels and the undeflected light.
    """
    lens, wavelength, z1 = chain.lens, chain.wavelength, chain.camera.separation
    # The phase of the light from an edge begins to change within a Fresnel zone of its shadow.
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
    """Return lens and Fresnel integral along one axis, (positions on the sensor, places there)."""
    lens, wavelength, z2 = chain.lens, chain.wavelength, chain.lens.image_distance
    path = (positions[:, None] - places) ** 2 / z2 - places**2 / lens.focal_length
    return np.asarray(np.exp(1j * np.pi / wavelength * path) / np.sqrt(1j * wavelength * z2))


class _LineSum:
    """The Fresnel integral along lines across the stop, to all positions x on the sensor."""

    def __init__(
        self, chain: ImagingChain, modulations: Sequence[Field], x: Array, slope: float
    ) -> None:
        self._chain, self._x = chain, x
        self._panel = SphericalWavePixels(chain) if chain.sphere else ParabolicWavePixels(chain)
        self._factors = LowRankModulations([self._panel.source_field(one) for one in modulations])
        reach = chain.stop_extent / chain.radius * (1 + _REACH_MARGIN)
        cell_count = max(1, math.ceil(slope * reach / _CELL_PHASE))
        self._edges = np.linspace(-reach, reach, cell_count + 1)
        self._t, self._w = roots_legendre(NODES_PER_CELL)
        self._half = (self._edges[1] - self._edges[0]) / 2
        middles = self._edges[:-1, None] + self._half
        self._nodes = (middles + self._half * self._t).ravel()
        weights = np.tile(self._half * self._w, middles.size)
        # The panel's light at the nodes, (nodes, ranks), one for each column of the factored panel,
        # in pieces, because there are many columns and many nodes.
        places = self._nodes * chain.radius
        self._panel_field = np.concatenate(
            [
                self._factors.apply_right_factors(self._panel.propagation_matrix(1, piece))
                for piece in np.array_split(places, math.ceil(places.size / _PLACES_AT_ONCE))
            ]
        )
        self._sensor_kernels = (_sensor_kernel(chain, x, places) * weights).T
        self._sums = self._cumulative_sums() if chain.lens.has_quadratic_phase else None
        # This matrix turns values at the nodes of a cell into the Legendre coefficients of the
        # polynomial through them.
        degrees = np.arange(NODES_PER_CELL)[:, None] + 0.5
        self._fit = degrees * legendre.legvander(self._t, NODES_PER_CELL - 1).T * self._w

    def _cumulative_sums(self) -> Field | None:
        """Return sums over the cells up to each edge, (edges, ranks, x), which all lines share.

        None if they take too much memory.
        """
        cells, ranks, places = self._edges.size - 1, self._panel_field.shape[1], self._x.size
        if cells * ranks * places > _MAX_SUMS:
            return None
        seen = self._panel_field.reshape(cells, NODES_PER_CELL, ranks).swapaxes(1, 2)
        each = seen @ self._sensor_kernels.reshape(cells, NODES_PER_CELL, places)
        return np.concatenate([np.zeros_like(each[:1]), np.cumsum(each, axis=0)])

    def __call__(self, lines: list[StopLine]) -> Field:
        """Return the integral along each line, (modulations, lines, x)."""
        heights = np.array([line.height for line in lines])
        rows = self._panel.propagation_matrix(0, heights * self._chain.radius) @ self._factors.left
        bent = self._phase_coefficients(heights)
        if self._sums is None:
            found = self._node_by_node(lines, rows, bent)
        else:
            found = self._cell_by_cell(lines, rows, self._sums)
        number, cell, ends = self._partial_cell_weights(lines, bent)
        cells = self._panel_field.reshape(-1, NODES_PER_CELL, self._panel_field.shape[1])
        for one, part in zip(found, self._factors.parts, strict=True):
            for n, c, end in zip(number, cell, ends, strict=True):
                one[n] += end @ (cells[c, :, part] @ rows[n, part])
        return found

    def _node_by_node(
        self, lines: list[StopLine], rows: Field, coefficients: Array | None
    ) -> Field:
        """Sum over the nodes of fully open cells."""
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
        """Return the indices of the first and last cell edge in an open piece of a line."""
        first = np.searchsorted(self._edges, low)
        return int(first), int(np.searchsorted(self._edges, high, side="right")) - 1

    def _open_cell_nodes(self, line: StopLine) -> NDArray[np.bool_]:
        """Return a mask of the nodes in cells that lie entirely in an open piece of the line."""
        found = np.zeros(self._nodes.size, dtype=bool)
        for low, high in line.open:
            first, last = self._whole_cells(low, high)
            found[first * NODES_PER_CELL : max(first, last) * NODES_PER_CELL] = True
        return found

    def _partial_cells(self, line: StopLine) -> Iterator[tuple[int, float, float]]:
        """Yield a line's open parts outside fully open cells: the cell, and the ends in radii."""
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
        """Return line, cell and quadrature weights of every open part of a partly open cell.

        The weights, (pieces, x, nodes), integrate the polynomial through the wave at the cell's
        nodes.
        """
        pieces = [
            (n, *piece) for n, line in enumerate(lines) for piece in self._partial_cells(line)
        ]
        nothing = (0, 0, self._edges[0], self._edges[0])
        columns = zip(*(pieces or [nothing]), strict=True)
        number, cell, low, high = (np.array(column) for column in columns)
        half = (high - low)[:, None] / 2
        nodes = low[:, None] + half * (1 + self._t)
        inside = (nodes - self._edges[cell][:, None]) / self._half - 1
        between = legendre.legvander(inside, NODES_PER_CELL - 1) @ self._fit
        onward = _sensor_kernel(self._chain, self._x, nodes.ravel() * self._chain.radius)
        onward = onward.reshape(-1, *nodes.shape).swapaxes(0, 1)
        passed = (
            half
            * self._w
            * self._lens_factor(None if coefficients is None else coefficients[:, number], nodes)
        )
        return number, cell, (onward * passed[:, None]) @ between

    def _phase_coefficients(self, heights: Array) -> Array | None:
        """Return Chebyshev coefficients along each line of what the lens adds to a quadratic phase.

        That is the aberrations, and the difference between a stigmatic and a thin lens: along a
        line a polynomial, or well approximated by one. None for a lens of quadratic phase.
        """
        chain, lens = self._chain, self._chain.lens
        if lens.has_quadratic_phase:
            return None
        whole = chain.distance + chain.camera.separation
        some = self._edges[-1] * chebyshev.chebpts1(_PHASE_DEGREE + 1)
        phases = [pupil_phase(lens, whole, chain.wavelength, float(h), some) for h in heights]
        r2 = (heights[:, None] ** 2 + some**2) * chain.radius**2
        thin = np.pi / chain.wavelength * (1 / whole - 1 / lens.focus_distance) * r2
        return np.linalg.solve(self._vander(some), (np.stack(phases) - thin).T)

    def _vander(self, nodes: Array) -> Array:
        return np.asarray(chebyshev.chebvander(nodes / self._edges[-1], _PHASE_DEGREE))

    def _lens_factor(self, coefficients: Array | None, nodes: Array) -> Field | Array:
        """Return the lens's factor without its quadratic phase, (lines, nodes).

        nodes: common to all lines, (nodes,), or of each line, (lines, nodes).
        """
        if coefficients is None:
            return np.ones((1, nodes.shape[-1]))
        return np.asarray(np.exp(1j * (self._vander(nodes) @ coefficients.T[..., None])[..., 0]))
