"""Go through the chain from panel to sensor by direct quadrature, row by row of the stop.

All light is followed, or as much of it as the tolerance takes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch

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
from optics.psf.axes import fresnel_area
from optics.psf.chain_engine import ChainEngine, search_seconds
from optics.psf.dim_windows import AddedLight, allowed_own_error, largest_ratio, window_norm
from optics.psf.lens_grid import TAPER_TOL_SHARE, limited_reach
from optics.psf.pixel_fields import PartialIntegrals, PixelFields, SortedEnds
from optics.psf.request import PSFRequest
from optics.psf.split_phase import SplitPhase
from optics.psf.stop_mask import StopLight, StopProbes, probe_places
from optics.psf.to_lens import TaperedBand


@dataclass(frozen=True)
class DirectSettings:
    """Tune what a DirectEngine leaves out, and what it tells of its price.

    reach_tol_share: share of the tolerance for light that isn't followed sideways to the stop's
    edge. Chosen.
    coarsest_inner_tol: largest tolerance for which the ends of what is followed are planned.
    Chosen.
    worthwhile_searches: time of the sum over all light, in searches, beyond which some light is
    left out if that takes less. Chosen.
    planning_calls: time of planning that doesn't depend on any size, in calls; measured.
    """

    reach_tol_share: float = 0.8
    coarsest_inner_tol: float = 2e-4
    worthwhile_searches: float = 3.0
    planning_calls: float = 40.0


_SETTINGS = DirectSettings()


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
        self._require_served()
        self.arithmetic = FLOAT64_ARITHMETIC
        low, high = n.lens.stop.opening.extent
        self._lens_wave = SplitPhase(n, ((low[0], high[0]), (low[1], high[1])))
        self._left_out = 0.0
        self._take_sum(DirectSum(n, self._camera, self._lens_wave))
        speed = n.budget.speed
        searches = self.total_seconds(n.budget) / search_seconds(speed)
        if searches > _SETTINGS.worthwhile_searches:
            self._limit_reach(n)
        self.sampling = f"{self._sum.row_count} rows of the stop"

    def _take_sum(self, one: DirectSum) -> None:
        """Take a sum into use, and estimate its rounding."""
        n = self._request.numeric
        self._sum, self._stop_light = one, one.stop_light()
        seen = self._edge_scatter.window_share / float(self.intensity_scale())
        count = math.prod(part.stop - part.start for part in n.window_slices)
        wrong = 2 * self._stop_light.even_error * math.sqrt(count)
        told = wrong / math.sqrt(seen) if seen > 0 else math.inf
        self.error = ErrorEstimate(told, "estimate of rounding, for an evenly lit panel")

    def _limit_reach(self, n: PSFRequest) -> None:
        """Leave out light that doesn't matter, where that takes less time."""
        whole, seconds = self._sum, self.total_seconds(n.budget)
        allowed = _SETTINGS.reach_tol_share * n.tol
        tol = min(n.tol, _SETTINGS.coarsest_inner_tol)
        reach = limited_reach(self._search, fresnel_area(n), allowed, tol)
        self._take_sum(DirectSum(n, self._camera, self._lens_wave, reach))
        if self.total_seconds(n.budget) < seconds:
            self._left_out = allowed + 2 * TAPER_TOL_SHARE * tol
            left = self._left_out + self.error.value
            self.error = ErrorEstimate(left, "estimate, for an evenly lit panel")
        else:
            self._take_sum(whole)

    def _require_served(self) -> None:
        """Raise ToleranceError for derivatives in lengths and for an exact spherical wave."""
        if self._request.differentiable:
            raise ToleranceError("direct quadrature of a chain has no derivatives in lengths")
        if self._request.sphere is not None:
            raise ToleranceError("direct quadrature of a chain takes the parabola of a wave only")

    @property
    def bytes(self) -> int:
        return self._sum.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._sum.cpu_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        seconds = super().planning_seconds(speed) + _SETTINGS.planning_calls * speed.call
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

    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        modulated = self.panel_field(phase, amplitude)
        if not modulated.numel():
            return self.empty_intensity(modulated)
        field = self._sum.field(modulated.cpu()).to(modulated.device)
        light = (field.real**2 + field.imag**2) * float(self.intensity_scale())
        rounding = self._rounding_error(modulated.detach().cpu(), field.detach().cpu())
        self._refuse_large_rounding(rounding, light.detach(), added)
        if self._left_out:
            return self._intensity_or_replan(light, phase, amplitude, added, rounding=rounding)
        return light

    def _refuse_large_rounding(
        self, rounding: float, light: torch.Tensor, added: AddedLight | None
    ) -> None:
        """Tell the error by rounding for the light in the window; ToleranceError if it's large."""
        norm = window_norm(light, self._request.window_slices)
        how = "estimate of rounding, for the light in the window"
        error = self.tell_error(rounding + self.arithmetic, norm, added, self.arithmetic, how)
        if not error <= self._promised_tol:
            allowed_own_error(self._promised_tol, norm, added)
            raise unreachable_tolerance_error(self._promised_tol, error)

    def _rounding_error(self, modulated: torch.Tensor, field: torch.Tensor) -> float:
        """Estimate the relative error by rounding for the light in the window.

        An error e of the field changes its intensity by 2 |field| e, and the L2 norm of the
        intensity is at least the light over the root of the number of samples.
        """
        window = self._request.window_slices
        seen = window_norm(field.abs(), window)
        count = math.prod(part.stop - part.start for part in window)
        wrong = 2 * math.sqrt(count) * self._stop_light.error(modulated)
        return largest_ratio(wrong, seen)


@dataclass(frozen=True)
class DirectSumSettings:
    """Tune the nodes of a direct sum, and what is predicted of its price.

    quadrature_tol: error for which the rows are planned, near double precision's rounding: the last
    digits cost a few percent.
    piece_turns: candidates for half the phase change along a piece of a row, in radians. Chosen.
    near_cost: time of a panel pixel's field at a near point, over that of a Bessel function;
    measured, like the next four.
    far_cost: the same at a far point.
    product_cost: time of a complex product and sum in double precision, over a real one in single
    precision.
    weight_cost: time of a real product for the weights of a row's end, over a complex one in the
    sums.
    node_touches: time of an end at a node, beside products, in passes over a complex number.
    sample_touches: the same of an end at a sensor's column.
    piece_calls: overhead of each piece of a row, in calls.
    kept_share: share of the memory in which the panel pixels' fields are kept between calls.
    Chosen.
    held_share: share of the memory in which the light on rows of the stop is held. Chosen.
    block_share: share of the memory for what is computed at once. Chosen.
    block_rows: most rows, or ends of rows, that are computed at once. Chosen.
    least_rows: rows below which a block isn't divided further. Chosen.
    """

    quadrature_tol: float = 1e-14
    piece_turns: tuple[float, ...] = (40.0, 20.0, 10.0)
    near_cost: float = 11.0
    far_cost: float = 1.3
    product_cost: float = 11.0
    weight_cost: float = 0.15
    node_touches: float = 35.0
    sample_touches: float = 25.0
    piece_calls: float = 2.0
    kept_share: float = 0.25
    held_share: float = 0.55
    block_share: float = 0.1
    block_rows: int = 4096
    least_rows: int = 64


_DIRECT_SUM_SETTINGS = DirectSumSettings()


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
        low, high = n.lens.stop.opening.extent
        self._spans = [(low[axis], high[axis]) for axis in (0, 1)]
        slopes = [self._pixels.steepest_slope(k, self._spans[k], lens) for k in (0, 1)]
        self._slopes = slopes
        self._bands = row_bands(n.lens.stop)
        counts = count_rows(self._bands, slopes[0], slopes[1], _DIRECT_SUM_SETTINGS.quadrature_tol)
        self.row_count = sum(counts)
        self._end_count = sum(
            2 * len(band.stretches) * count for band, count in zip(self._bands, counts, strict=True)
        )
        self._chunks: list[_RowChunk] = []
        self._kept: list[torch.Tensor] | None = None
        self._integrals = self._cheapest_pieces()

    def _cheapest_pieces(self) -> PartialIntegrals:
        """Divide the rows of the stop into pieces that take the least time."""
        found = []
        for turn in _DIRECT_SUM_SETTINGS.piece_turns:
            self._integrals = PartialIntegrals(*self._spans[1], self._slopes[1], turn)
            found.append((self.cpu_seconds(self._n.budget.speed), self._integrals))
        return min(found, key=lambda one: one[0])[1]

    def stop_light(self) -> StopLight:
        """Sample the light in the stop, which tells the rounding of the sum."""
        independent = self.row_count, self._integrals.node_count
        y, x = (
            StopProbes(
                self._pixels.fields(axis, probe_places(*span)),
                self._pixels.path_turns(axis, probe_places(*span)),
                independent[axis],
            )
            for axis, span in enumerate(self._spans)
        )
        box = math.prod(high - low for low, high in self._spans)
        return StopLight(y, x, self._n.lens.stop.area, box)

    @property
    def _column_count(self) -> int:
        """The columns of integrals over whole pieces: a sample's for each lens term."""
        return self._n.samples.shape[1] * self._lens.terms

    @property
    def _kernel_counts(self) -> tuple[int, int]:
        """The numbers of pixels' fields along both axes that are computed."""
        down, along = self._widths
        rows = self.row_count * self._pixels.reached_count(0, down)
        return int(rows), int(self._integrals.node_count * self._pixels.reached_count(1, along))

    @property
    def _widths(self) -> tuple[float, float]:
        """The widths of blocks of rows, and of groups of pieces, in stop radii."""
        low, high = self._spans[0]
        return (high - low) * self._block_size / self.row_count, (
            self._group_size * self._integrals.width
        )

    @property
    def _block_size(self) -> int:
        """Rows of the stop for which pixels' fields are computed at once.

        They spread over no more than half of the width that the light of a point gets.
        """
        low, high = self._spans[0]
        share = self._pixels.reached_width(0) / (high - low) / 2
        within = self.row_count * min(share, 1.0)
        return int(max(_DIRECT_SUM_SETTINGS.least_rows, min(self._most_rows, within)))

    @property
    def _block_row_bytes(self) -> int:
        """Memory for what is computed at once, for each row, or end of a row."""
        within = 3 * max(self._panel.shape) + 4 * self._integrals.nodes + self._n.samples.shape[0]
        return 16 * within

    @property
    def _most_rows(self) -> int:
        """Most rows, or ends of rows, that are computed at once."""
        more = self._allowed(_DIRECT_SUM_SETTINGS.block_share) // self._block_row_bytes
        return min(_DIRECT_SUM_SETTINGS.block_rows, _DIRECT_SUM_SETTINGS.least_rows + more)

    @property
    def _group_size(self) -> int:
        """Pieces for which pixels' fields are computed at once."""
        within = min(self._pixels.reached_width(1) / 8, self._pixels.near_width / 4)
        most = max(1, self._most_rows // self._integrals.nodes)
        return max(1, min(most, int(within / self._integrals.width)))

    @property
    def _row_bytes(self) -> int:
        """Memory for each row that is held: the light on it, its sums, the lens' wave, its ends."""
        held = self._panel.shape[1] + self._n.samples.shape[1] + 2 * self._lens.terms
        return 16 * (held + math.ceil(2 * self._end_count / self.row_count))

    @property
    def _least_bytes(self) -> int:
        """Memory that the sum takes in the smallest blocks and chunks."""
        whole = 40 * self._end_count + 32 * self._panel.shape[1] * self._column_count
        return whole + _DIRECT_SUM_SETTINGS.least_rows * (self._row_bytes + self._block_row_bytes)

    def _allowed(self, share: float) -> int:
        """Return a share of the memory beyond what the sum takes in any case, bytes."""
        return int(share * max(0, self._n.budget.memory - self._least_bytes))

    @property
    def _chunk_rows(self) -> int:
        most = (
            _DIRECT_SUM_SETTINGS.least_rows
            + self._allowed(_DIRECT_SUM_SETTINGS.held_share) // self._row_bytes
        )
        return math.ceil(self.row_count / math.ceil(self.row_count / most))

    @property
    def _chunk_count(self) -> int:
        return math.ceil(self.row_count / self._chunk_rows)

    @property
    def _keeps_kernels(self) -> bool:
        return 16 * sum(self._kernel_counts) <= self._allowed(_DIRECT_SUM_SETTINGS.kept_share)

    @property
    def bytes(self) -> int:
        least = _DIRECT_SUM_SETTINGS.least_rows
        held = self._least_bytes + max(0, self._chunk_rows - least) * self._row_bytes
        held += (self._most_rows - least) * self._block_row_bytes
        return held + (16 * sum(self._kernel_counts) if self._keeps_kernels else 0)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        columns, chunks = self._panel.shape[1], self._chunk_count
        width, nodes = self._column_count, self._integrals.nodes
        height, across = self._n.samples.shape
        down, along = self._kernel_counts
        each = along / self._integrals.pieces + columns * width
        each += nodes * (across + self._lens.terms) + _DIRECT_SUM_SETTINGS.weight_cost * nodes**2
        products = down * columns + self.row_count * across * height
        products += self._end_count * each + chunks * along * width
        seconds = _DIRECT_SUM_SETTINGS.product_cost * products * speed.multiply_add
        touches = (
            _DIRECT_SUM_SETTINGS.node_touches * nodes + _DIRECT_SUM_SETTINGS.sample_touches * width
        )
        seconds += self._end_count * touches * speed.touch
        seconds += (
            _DIRECT_SUM_SETTINGS.piece_calls * chunks * (3 + self._integrals.pieces) * speed.call
        )
        return seconds + (0.0 if self._keeps_kernels else self._kernel_seconds(speed))

    def _kernel_seconds(self, speed: MachineSpeed) -> float:
        times = 1 if self._keeps_kernels else self._chunk_count
        places = self.row_count, times * self._integrals.node_count
        costs = 0.0
        for axis, (count, width) in enumerate(zip(places, self._widths, strict=True)):
            near = self._pixels.near_count(axis, width)
            far = self._pixels.reached_count(axis, width) - near
            costs += count * (
                _DIRECT_SUM_SETTINGS.near_cost * near + _DIRECT_SUM_SETTINGS.far_cost * far
            )
        return costs * speed.bessel

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return self._kernel_seconds(speed) if self._keeps_kernels else 0.0

    def prepare(self) -> None:
        """Find the rows of the stop, and compute the pixels' fields that are kept."""
        down, along = self._slopes
        rows = quadrature_rows(self._bands, down, along, _DIRECT_SUM_SETTINGS.quadrature_tol)
        self._chunks = [
            _RowChunk(part, self._integrals.sort_ends(part.end))
            for part in rows.split(self._chunk_rows)
        ]
        self._lens.prepare()
        if self._keeps_kernels:
            for chunk in self._chunks:
                chunk.kept = [kernel for _, kernel in self._row_kernels(chunk)]
            self._kept = [kernel for _, _, kernel in self._group_kernels()]

    def _row_kernels(self, chunk: _RowChunk) -> Iterator[tuple[slice, torch.Tensor]]:
        """Yield panel rows that light some rows of the stop, and their fields, (rows, pixels)."""
        for number, y in enumerate(torch.split(chunk.y, self._block_size)):
            pixels = self._pixels.reached(0, y)
            kept = chunk.kept[number] if chunk.kept else self._pixels.fields(0, y, pixels)
            yield pixels, kept

    def _group_kernels(self) -> Iterator[tuple[int, slice, torch.Tensor]]:
        """Yield the first piece of each group, panel columns that light it, and their fields."""
        group = self._group_size
        for first in range(0, self._integrals.pieces, group):
            some = range(first, min(first + group, self._integrals.pieces))
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
        """Compute the field at the sensor, (..., rows, columns), in square stop radii.

        modulated: the field behind the panel, (..., rows, columns), complex128.
        """
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
            for ends, partial in chunk.ends.in_piece(piece, self._most_rows):
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
        for start in range(0, len(chunk.y), self._most_rows):
            some = slice(start, start + self._most_rows)
            total = total + self._sensor_kernel(0, chunk.y[some]).mT @ found[..., some, :]
        return total

    def _sensor_kernel(self, axis: int, place: torch.Tensor) -> torch.Tensor:
        """Return the Fourier kernel from places in the stop to samples, (places, samples)."""
        n = self._n
        turns = torch.outer(place, n.samples.coordinates(axis)) * (-n.radius / n.scale)
        return unit_phasor(turns, torch.complex128)


class _RowChunk:
    """Holds rows of the stop as tensors, their sorted ends, and kept fields of pixels."""

    def __init__(self, rows: Rows, ends: SortedEnds) -> None:
        self.y, self.weight, self.row = map(torch.from_numpy, (rows.y, rows.weight, rows.row))
        self.sign = torch.from_numpy(rows.sign)[:, None]
        self.ends = ends
        self.kept: list[torch.Tensor] = []
