"""Go through the chain from panel to sensor by direct quadrature, row by row of the stop.

All light is followed, or as much of it as the tolerance takes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    unreachable_tolerance_error,
)
from optics.camera import Camera
from optics.camera.stop_rows import Rows, count_rows, quadrature_rows, row_bands
from optics.fourier import unit_phasor
from optics.gauss_legendre import gauss_legendre
from optics.psf.chain_engine import ChainEngine, ChainLight, search_seconds
from optics.psf.dim_windows import AddedLight, allowed_own_error, largest_ratio, window_norm
from optics.psf.edge_scatter import fresnel_area
from optics.psf.lens_grid import TAPER_TOL_SHARE, limited_reach
from optics.psf.pixel_fields import PixelFields, SplitPhase
from optics.psf.request import PSFRequest
from optics.psf.stop_mask import StopLight, StopProbes, probe_places
from optics.psf.to_lens import TaperedBand

Array = NDArray[np.float64]

_REACH_TOL_SHARE = 0.8  # of the tolerance, for light that isn't followed to the edge; chosen
_COARSEST_INNER_TOL = 2e-4  # for which the ends of what is followed are planned; chosen

_WORTHWHILE_SEARCHES = 3.0  # time of the sum over all light beyond which less is tried; chosen
_PLANNING_CALLS = 40.0  # time of planning that doesn't depend on any size, in calls; measured


class DirectEngine(ChainEngine):
    """Computes the PSF by integrals over the panel's pixels and over rows of the stop.

    A pixel's field at the lens is a product of Fresnel integrals along y and x, in closed form
    (see PixelFields). Along the rows of the stop it is integrated in closed form, too (see
    DirectSum). A lens' wave that isn't a product of factors along y and x is a short sum of such
    products (see SplitPhase). So the work grows with the number of rows, not with that of nodes in
    the stop.

    Where that takes little time, all light is followed, and only the rounding of double precision
    limits the error. It is estimated for the light that reaches the window, from the light in the
    stop (see StopLight). Elsewhere, a pixel's light is followed only so far sideways as the
    tolerance takes (see `limited_reach`). For a panel near to its stop, that leaves few pixels at
    each place, and few rows.
    """

    name = "chain, direct"
    precision = "float64"
    _dtype = torch.complex128

    def _plan(self, n: PSFRequest) -> None:
        if self._request.differentiable:
            raise ToleranceError("direct quadrature of a chain has no derivatives in lengths")
        if self._request.sphere is not None:
            raise ToleranceError("direct quadrature of a chain takes the parabola of a wave only")
        self.arithmetic, self._left_out = FLOAT64_ARITHMETIC, 0.0
        lens = SplitPhase(n)
        whole = DirectSum(n, self._camera, lens)
        self._take_sum(whole)
        seconds = self.total_seconds(n.budget)
        if seconds / search_seconds(n.budget.speed) > _WORTHWHILE_SEARCHES:
            # Light that doesn't matter is left out, where that takes less time.
            allowed, tol = _REACH_TOL_SHARE * n.tol, min(n.tol, _COARSEST_INNER_TOL)
            reach = limited_reach(self._search, fresnel_area(n), allowed, tol)
            self._take_sum(DirectSum(n, self._camera, lens, reach))
            if self.total_seconds(n.budget) < seconds:
                self._left_out = allowed + 2 * TAPER_TOL_SHARE * tol
                left = self._left_out + self.error.value
                self.error = ErrorEstimate(left, "estimate, for an evenly lit panel")
            else:
                self._take_sum(whole)
        self.sampling = f"{self._sum.row_count} rows of the stop"

    def _take_sum(self, one: DirectSum) -> None:
        """Take a sum into use, and estimate its rounding."""
        self._sum, self._stop_light = one, one.stop_light()
        seen = self._edge_scatter.window_share / float(self.intensity_scale())
        wrong = 2 * self._stop_light.even_error * math.sqrt(self._window_samples)
        told = wrong / math.sqrt(seen) if seen > 0 else math.inf
        self.error = ErrorEstimate(told, "estimate of rounding, for an evenly lit panel")

    @property
    def _window_samples(self) -> int:
        """The number of samples in the window."""
        return math.prod(part.stop - part.start for part in self._request.window_slices)

    @property
    def bytes(self) -> int:
        return self._sum.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._sum.cpu_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        seconds = super().planning_seconds(speed) + _PLANNING_CALLS * speed.call
        if not self.error.value + self.arithmetic <= self._request.tol:
            seconds += self.cpu_seconds(speed)
        return seconds + self._sum.planning_seconds(speed)

    def prepare(self) -> None:
        self._sum.prepare()
        if not self.error.value + self.arithmetic <= self._request.tol:
            # The light that the edge of the stop sends to a dark window isn't known beforehand.
            with torch.no_grad():
                self.intensity(None, None)
            self._planned_error = self.error

    def _light(
        self, field: torch.Tensor, amplitude: torch.Tensor | None, added: AddedLight | None
    ) -> ChainLight:
        seen = self._sum.field(field.cpu()).to(field.device)
        light = (seen.real**2 + seen.imag**2) * float(self.intensity_scale())
        # An error e of the field changes its intensity by 2 |field| e, and the L2 norm of the
        # intensity is at least the light over the root of the number of samples.
        window, promised = self._request.window_slices, self._promised_tol
        field_error = self._stop_light.error(field.detach().cpu())
        wrong = 2 * math.sqrt(self._window_samples) * field_error
        rounding = largest_ratio(wrong, window_norm(seen.detach().cpu().abs(), window))
        norm = window_norm(light.detach(), window)
        how = "estimate of rounding, for the light in the window"
        error = self.tell_error(rounding + self.arithmetic, norm, added, self.arithmetic, how)
        if not error <= promised:
            allowed_own_error(promised, norm, added)
            raise unreachable_tolerance_error(promised, error)
        return ChainLight(light, rounding, is_judged=not self._left_out)


_QUADRATURE_TOL = 1e-14  # for the rows, near rounding: the last digits cost a few percent
_PIECE_TURNS = (40.0, 20.0, 10.0)  # rad, for half the phase change along a piece of a row; chosen

# Predicted times; measured.
_NEAR_COST = 11.0  # of a panel pixel's field at a near point, over that of a Bessel function
_FAR_COST = 1.3  # the same at a far point
_PRODUCT_COST = 11.0  # of a complex product and sum in double precision, over a real single one
_WEIGHT_COST = 0.15  # of a real product for the weights of a row's end, over a complex one in sums
_NODE_TOUCHES = 35.0  # of an end at a node, beside products, in passes over a complex number
_SAMPLE_TOUCHES = 25.0  # the same of an end at a sensor's column
_PIECE_CALLS = 2.0  # of each piece of a row, in calls

# Shares of the memory, and numbers of rows; chosen.
_KEPT_SHARE = 0.25  # for the panel pixels' fields that are kept between calls
_HELD_SHARE = 0.55  # for the light on rows of the stop
_BLOCK_SHARE = 0.1  # for what is computed at once
_BLOCK_ROWS = 4096  # most rows, or ends of rows, that are computed at once
_LEAST_ROWS = 64  # below which a block isn't divided further


class _Blocks(NamedTuple):
    """What is computed or held at once, as the memory allows; widths are in stop radii."""

    rows: int  # of the stop for which pixels' fields are computed
    ends: int  # rows, or ends of rows, in a product
    group: int  # pieces of rows for which pixels' fields are computed
    chunk: int  # rows on which the light is held
    chunk_count: int
    widths: tuple[float, float]  # of `rows` rows, and of `group` pieces
    kernel_counts: tuple[int, int]  # pixels' fields along both axes that are computed
    keeps_kernels: bool  # between calls
    bytes: int  # of everything


class DirectSum:
    """Sums the light at the sensor over the panel's pixels and over rows of the stop.

    Along the rows, each pixel's field times the lens' wave and the Fourier kernel of the sensor is
    integrated once, from the left; the row's ends select the part that the stop leaves open (see
    `PartialIntegrals`). The rows are divided into chunks that fit the memory.

    n, camera: what is asked, in plain numbers.
    lens: the lens' wave.
    reach: bands (y, x) of the light that is followed; None for all.
    """

    def __init__(
        self,
        n: PSFRequest,
        camera: Camera,
        lens: SplitPhase,
        reach: Sequence[TaperedBand] | None = None,
    ) -> None:
        self._n, self._panel, self._lens = n, camera.panel, lens
        self._pixels = PixelFields(n, camera, reach)
        self._slopes = self._pixels.steepest_slope(0, lens), self._pixels.steepest_slope(1, lens)
        self._bands = row_bands(n.lens.stop)
        counts = count_rows(self._bands, *self._slopes, _QUADRATURE_TOL)
        self.row_count = sum(counts)
        self._end_count = sum(
            2 * len(band.stretches) * count for band, count in zip(self._bands, counts, strict=True)
        )
        self._chunks: list[_RowChunk] = []
        self._kept: list[torch.Tensor] | None = None
        # The rows of the stop are divided into pieces that take the least time.
        found = []
        for turn in _PIECE_TURNS:
            self._integrals = PartialIntegrals(*lens.spans[1], self._slopes[1], turn)
            self._blocks = self._plan_blocks()
            found.append((self.cpu_seconds(n.budget.speed), self._integrals, self._blocks))
        _, self._integrals, self._blocks = min(found, key=lambda one: one[0])

    def stop_light(self) -> StopLight:
        """Sample the light in the stop, which tells the rounding of the sum."""
        independent = self.row_count, self._integrals.node_count
        y, x = (
            StopProbes(
                self._pixels.fields(axis, probe_places(*span)),
                self._pixels.path_turns(axis, probe_places(*span)),
                independent[axis],
            )
            for axis, span in enumerate(self._lens.spans)
        )
        box = math.prod(high - low for low, high in self._lens.spans)
        return StopLight(y, x, self._n.lens.stop.area, box)

    @property
    def _column_count(self) -> int:
        """The columns of integrals over whole pieces: a sample's for each lens term."""
        return self._n.samples.shape[1] * self._lens.terms

    def _plan_blocks(self) -> _Blocks:
        """Divide rows, pieces and ends so that what is held at once fits the memory."""
        pixels, integrals, (low, high) = self._pixels, self._integrals, self._lens.spans[0]
        panel, (height, across) = self._panel.shape, self._n.samples.shape
        # For each row, or end of a row, that is computed at once.
        each = 16 * (3 * max(panel) + 4 * integrals.nodes + height)
        # For each row that is held: the light on it, its sums, the lens' wave, its ends.
        ends = math.ceil(2 * self._end_count / self.row_count)
        held = 16 * (panel[1] + across + 2 * self._lens.terms + ends)
        least = 40 * self._end_count + 32 * panel[1] * self._column_count
        least += _LEAST_ROWS * (held + each)
        room = max(0, self._n.budget.memory - least)
        most = min(_BLOCK_ROWS, _LEAST_ROWS + int(_BLOCK_SHARE * room) // each)
        # Rows spread over no more than half of the width that the light of a point gets.
        within = self.row_count * min(pixels.reached_width(0) / (high - low) / 2, 1.0)
        rows = int(max(_LEAST_ROWS, min(most, within)))
        within = min(pixels.reached_width(1) / 8, pixels.near_width / 4)
        group = max(1, min(max(1, most // integrals.nodes), int(within / integrals.width)))
        chunk = _LEAST_ROWS + int(_HELD_SHARE * room) // held
        chunk = math.ceil(self.row_count / math.ceil(self.row_count / chunk))
        widths = (high - low) * rows / self.row_count, group * integrals.width
        down = int(self.row_count * pixels.reached_count(0, widths[0]))
        along = int(integrals.node_count * pixels.reached_count(1, widths[1]))
        kernels = 16 * (down + along)
        keeps = kernels <= int(_KEPT_SHARE * room)
        whole = least + max(0, chunk - _LEAST_ROWS) * held + (most - _LEAST_ROWS) * each
        whole += kernels if keeps else 0
        count = math.ceil(self.row_count / chunk)
        return _Blocks(rows, most, group, chunk, count, widths, (down, along), keeps, whole)

    @property
    def bytes(self) -> int:
        return self._blocks.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        columns, chunks = self._panel.shape[1], self._blocks.chunk_count
        width, nodes = self._column_count, self._integrals.nodes
        height, across = self._n.samples.shape
        down, along = self._blocks.kernel_counts
        each = along / self._integrals.pieces + columns * width
        each += nodes * (across + self._lens.terms) + _WEIGHT_COST * nodes**2
        products = down * columns + self.row_count * across * height
        products += self._end_count * each + chunks * along * width
        seconds = _PRODUCT_COST * products * speed.multiply_add
        touches = _NODE_TOUCHES * nodes + _SAMPLE_TOUCHES * width
        seconds += self._end_count * touches * speed.touch
        seconds += _PIECE_CALLS * chunks * (3 + self._integrals.pieces) * speed.call
        return seconds + (0.0 if self._blocks.keeps_kernels else self._kernel_seconds(speed))

    def _kernel_seconds(self, speed: MachineSpeed) -> float:
        times = 1 if self._blocks.keeps_kernels else self._blocks.chunk_count
        places = self.row_count, times * self._integrals.node_count
        costs = 0.0
        for axis, (count, width) in enumerate(zip(places, self._blocks.widths, strict=True)):
            near = self._pixels.near_count(axis, width)
            far = self._pixels.reached_count(axis, width) - near
            costs += count * (_NEAR_COST * near + _FAR_COST * far)
        return costs * speed.bessel

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return self._kernel_seconds(speed) if self._blocks.keeps_kernels else 0.0

    def prepare(self) -> None:
        """Find the rows of the stop, and compute the pixels' fields that are kept."""
        rows = quadrature_rows(self._bands, *self._slopes, _QUADRATURE_TOL)
        self._chunks = [_RowChunk(part, self._integrals) for part in rows.split(self._blocks.chunk)]
        self._lens.prepare()
        # The number of the lens' terms is known now.
        self._blocks = self._plan_blocks()
        if self._blocks.keeps_kernels:
            for chunk in self._chunks:
                chunk.kept = [kernel for _, kernel in self._row_kernels(chunk)]
            self._kept = [kernel for _, _, kernel in self._group_kernels()]

    def _row_kernels(self, chunk: _RowChunk) -> Iterator[tuple[slice, torch.Tensor]]:
        """Yield panel rows that light some rows of the stop, and their fields, (rows, pixels)."""
        for number, y in enumerate(torch.split(chunk.y, self._blocks.rows)):
            pixels = self._pixels.reached(0, y)
            kept = chunk.kept[number] if chunk.kept else self._pixels.fields(0, y, pixels)
            yield pixels, kept

    def _group_kernels(self) -> Iterator[tuple[int, slice, torch.Tensor]]:
        """Yield the first piece of each group, panel columns that light it, and their fields."""
        group, pieces = self._blocks.group, self._integrals.pieces
        for first in range(0, pieces, group):
            some = range(first, min(first + group, pieces))
            place = torch.cat([self._integrals.places(piece) for piece in some])
            pixels = self._pixels.reached(1, place)
            kept = self._kept[first // group] if self._kept else None
            yield first, pixels, self._pixels.fields(1, place, pixels) if kept is None else kept

    def _piece_kernels(self) -> Iterator[tuple[int, slice, torch.Tensor]]:
        """Yield each piece, panel columns that light it, and their fields, (nodes, pixels)."""
        for first, pixels, kernels in self._group_kernels():
            for number, kernel in enumerate(torch.split(kernels, self._integrals.nodes)):
                yield first + number, pixels, kernel

    def field(self, modulated: torch.Tensor) -> torch.Tensor:
        """Compute the field at the sensor, in square stop radii, from that behind the panel."""
        parts = [self._chunk_field(modulated, chunk) for chunk in self._chunks]
        return sum(parts[1:], parts[0])

    def _chunk_field(self, modulated: torch.Tensor, chunk: _RowChunk) -> torch.Tensor:
        """Compute the field at the sensor from some rows of the stop."""
        sent = modulated.new_empty(*modulated.shape[:-2], len(chunk.y), modulated.shape[-1])
        done = 0
        for pixels, kernel in self._row_kernels(chunk):
            sent[..., done : done + len(kernel), :] = kernel @ modulated[..., pixels, :]
            done += len(kernel)
        found = modulated.new_zeros(*sent.shape[:-1], self._n.samples.shape[1])
        along_y = self._lens.along(0, chunk.y) * chunk.weight[:, None]
        before = along_y.new_zeros(modulated.shape[-1], self._column_count)
        for piece, pixels, kernel in self._piece_kernels():
            place = self._integrals.places(piece)
            lens, sensor = self._lens.along(1, place), self._sensor_kernel(1, place)
            for ends, partial in chunk.ends_in_piece(piece, self._blocks.ends):
                row = chunk.row[ends]
                left = along_y[row] * chunk.sign[ends]
                arriving = sent.index_select(-2, row)
                light = (arriving[..., pixels] @ kernel.mT) * (left @ lens.mT)
                # A product of complex and real numbers takes longer.
                light = torch.view_as_complex(torch.view_as_real(light) * partial[:, :, None])
                so_far = slice(0, pixels.stop)
                whole = arriving[..., so_far] @ before[so_far]
                whole = whole.reshape(*whole.shape[:-1], lens.shape[1], sensor.shape[1])
                found.index_add_(-2, row, light @ sensor + (whole * left[:, :, None]).sum(-2))
            if pixels.stop > pixels.start:
                both = (lens[:, :, None] * sensor[:, None, :]).flatten(1)
                # What derivatives are taken of stays as it is.
                before = before.clone()
                before[pixels] += (kernel * self._integrals.weights[:, None]).mT @ both
        total = found.new_zeros(*found.shape[:-2], *self._n.samples.shape)
        for start in range(0, len(chunk.y), self._blocks.ends):
            some = slice(start, start + self._blocks.ends)
            total = total + self._sensor_kernel(0, chunk.y[some]).mT @ found[..., some, :]
        return total

    def _sensor_kernel(self, axis: int, place: torch.Tensor) -> torch.Tensor:
        """Return the Fourier kernel from places in the stop to samples, (places, samples)."""
        n = self._n
        turns = torch.outer(place, n.samples.coordinates(axis)) * (-n.radius / n.scale)
        return unit_phasor(turns, torch.complex128)


class _RowChunk:
    """Holds rows of the stop as tensors, their ends by the pieces of a row, and kept fields."""

    def __init__(self, rows: Rows, integrals: PartialIntegrals) -> None:
        self.y, self.weight, self.row = map(torch.from_numpy, (rows.y, rows.weight, rows.row))
        self.sign = torch.from_numpy(rows.sign)[:, None]
        self.kept: list[torch.Tensor] = []
        self._integrals = integrals
        place = (rows.end - integrals.low) / integrals.width
        piece = np.clip(place.astype(np.int64), 0, integrals.pieces - 1)
        # Each end's place in its piece, -1 to 1; the ends piece by piece, and where each begins.
        self._inside = np.clip(2 * (place - piece) - 1, -1, 1)
        self._order = np.argsort(piece, kind="stable")
        self._starts = np.searchsorted(piece[self._order], np.arange(integrals.pieces + 1))

    def ends_in_piece(self, piece: int, most: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yield the ends in a piece, `most` at a time, and each one's weights, (ends, nodes)."""
        first, last = self._starts[piece], self._starts[piece + 1]
        for start in range(first, last, most):
            ends = self._order[start : min(start + most, last)]
            yield torch.from_numpy(ends), self._integrals.partial_weights(self._inside[ends])


class PartialIntegrals:
    """Divides rows of the stop into pieces, whose nodes interpolate the integrand.

    In a piece, the values at Gauss-Legendre nodes determine a polynomial. Its integral up to any
    end is a sum over the nodes, whose weights depend on the end alone. Whole pieces to the left are
    summed with the usual weights.

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
        self.low, self.width = low, (high - low) / self.pieces

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
        return torch.from_numpy(self.low + self.width * (piece + (nodes + 1) / 2))

    def partial_weights(self, inside: Array) -> torch.Tensor:
        """Return the weights (ends, nodes) of ends at places -1 to 1 in their pieces."""
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
