"""Compute the PSF through the chain from panel to sensor by direct quadrature, row by row."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    unreachable_tolerance_error,
)
from optics.chain.engine import ChainEngine
from optics.chain.partial_integrals import PartialIntegrals
from optics.chain.propagator_axes import fresnel_area
from optics.chain.split_phase import SplitPhase
from optics.fourier import unit_phasor
from optics.propagation.fresnel_integral import cell_kernel
from optics.psf_engines.request import PSFRequest
from optics.psf_engines.window_error import (
    AddedLight,
    allowed_own_error,
    error_beside,
    largest_ratio,
    window_norm,
)
from optics.stop.rows import Rows, count_rows, quadrature_rows, row_bands


@dataclass(frozen=True)
class DirectSettings:
    """Tune a DirectEngine's nodes, and what it tells of its error and its price.

    Attributes
    ----------
    quadrature_tol : float
        Error for which the rows are planned, near double precision's rounding: the last digits
        cost a few percent.
    roundings : float
        Roundings of double precision that the field's error may amount to, over what they would be
        if all errors in the stop added up. Chosen.
    probes : int
        Places along each axis of the stop at which the light there is sampled. Chosen.
    piece_turn : float
        Half the phase change along a piece of a row, in radians. Chosen.
    kernel_cost : float
        Time of a panel pixel's field at a point, over that of a Bessel function; measured, like the
        next two.
    product_cost : float
        Time of a complex product and sum in double precision, over a real one in single precision.
    piece_calls : float
        Overhead of each piece of a row, in calls.
    planning_calls : float
        Time of planning that doesn't depend on any size, in calls; measured.
    kept_share : float
        Share of the memory in which the panel pixels' fields are kept between calls. Chosen.
    block_rows : int
        Rows for which fields of the panel's pixels are computed at once.
    """

    quadrature_tol: float = 1e-14
    roundings: float = 4.0
    probes: int = 10
    piece_turn: float = 40.0
    kernel_cost: float = 11.0
    product_cost: float = 11.0
    piece_calls: float = 2.0
    planning_calls: float = 40.0
    kept_share: float = 0.25
    block_rows: int = 4096


_SETTINGS = DirectSettings()


class DirectEngine(ChainEngine):
    """Computes the PSF by integrals over the panel's pixels and over rows of the stop.

    A pixel's field at the lens is a product of Fresnel integrals along y and x, in closed form
    (see `cell_kernel`). No frequency and no light is left out. Along the rows of the stop, each
    pixel's field times the lens' wave and the Fourier kernel of the sensor is integrated once,
    from the left; the row's ends select the part that the stop leaves open (see
    `PartialIntegrals`). A lens' wave that isn't a product of factors along y and x is a short sum
    of such products (see SplitPhase). So the work grows with the number of rows, not with that of
    nodes in the stop.

    Only the rounding of double precision limits the error. It is estimated for the light that
    reaches the window, from the light in the stop (see `_StopLight`).
    """

    name = "chain, direct"
    precision = "float64"
    _dtype = torch.complex128

    def _plan(self, n: PSFRequest) -> None:
        self._require_served()
        self.arithmetic = FLOAT64_ARITHMETIC
        opening = n.lens.stop.opening.extent
        spans = ((opening[0][0], opening[1][0]), (opening[0][1], opening[1][1]))
        self._lens_wave = SplitPhase(n, spans)
        self._area = fresnel_area(n)
        slopes = [self._steepest_slope(n, axis, spans[axis]) for axis in (0, 1)]
        self._bands, self._slopes = row_bands(n.lens.stop), slopes
        counts = count_rows(self._bands, slopes[0], slopes[1], _SETTINGS.quadrature_tol)
        self._row_count = sum(counts)
        self._end_count = sum(
            2 * len(band.stretches) * count for band, count in zip(self._bands, counts, strict=True)
        )
        self._integrals = PartialIntegrals(*spans[1], slopes[1], _SETTINGS.piece_turn)
        self._rows: Rows | None = None
        self._kept: tuple[list[torch.Tensor], list[torch.Tensor]] | None = None
        self.sampling = f"{self._row_count} rows of the stop"
        seen = self._edge_scatter.window_share / float(self._intensity_factor)
        count = math.prod(part.stop - part.start for part in n.window_slices)
        self._stop_light = _StopLight(self, spans)
        wrong = 2 * self._stop_light.even_error * math.sqrt(count)
        told = wrong / math.sqrt(seen) if seen > 0 else math.inf
        self.error = ErrorEstimate(told, "estimate of rounding, for an evenly lit panel")

    def _require_served(self) -> None:
        """Raise ToleranceError for what a chain's direct quadrature doesn't serve."""
        if self._request.differentiable:
            raise ToleranceError("direct quadrature of a chain has no derivatives in lengths")
        if self._request.sphere is not None:
            raise ToleranceError("direct quadrature of a chain takes the parabola of a wave only")

    def _steepest_slope(self, n: PSFRequest, axis: int, span: tuple[float, float]) -> float:
        """Bound the phase slope of a chain's light in the stop, radians per stop radius.

        Light from a point of the panel, the lens, and the kernel of a sensor sample each add a
        slope that is linear in the places, so that the extremes lie at their ends.
        """
        grow = n.radius / float(n.shadow_magnification)
        line, half = self._camera.panel.plane.coordinates(axis), self._camera.panel.pitch / 2
        shift = float(n.chief_ray_slopes[axis]) * n.separation
        seen = n.samples.coordinates(axis)
        slopes = [
            2 * math.pi * grow * (grow * place - shift - start) / self._area
            + 2 * self._lens_wave.curvature * place
            - 2 * math.pi * n.radius * sample / n.scale
            for place in span
            for start in (float(line[0]) - half, float(line[-1]) + half)
            for sample in (float(seen.min()), float(seen.max()))
        ]
        return max(map(abs, slopes)) + self._lens_wave.slope

    @property
    def _intensity_factor(self) -> float:
        return float(self.intensity_scale())

    @property
    def _column_count(self) -> int:
        """The columns of a chain's integrals over whole pieces: a sample's for each lens term."""
        return self._request.samples.shape[1] * self._lens_wave.terms

    @property
    def _kernel_count(self) -> int:
        """The panel pixels' fields along the two axes that the chain takes."""
        rows, columns = self._camera.panel.shape
        times = 1 if self._keeps_rows else self._end_count / self._row_count
        return int(times * self._row_count * rows) + self._integrals.node_count * columns

    @property
    def _keeps_rows(self) -> bool:
        """Whether the light on all rows is in memory; else that on each piece's rows, twice."""
        held = 32 * self._row_count * self._camera.panel.shape[1]
        return held <= _SETTINGS.kept_share * self._request.budget.memory

    @property
    def _keeps_kernels(self) -> bool:
        allowed = _SETTINGS.kept_share * self._request.budget.memory
        return self._keeps_rows and 16 * self._kernel_count <= allowed

    @property
    def bytes(self) -> int:
        columns, across = self._camera.panel.shape[1], self._request.samples.shape[1]
        held = self._row_count * (across + 2 * self._lens_wave.terms)
        held += 2 * self._row_count * columns if self._keeps_rows else 0
        held += 4 * self._end_count + 2 * columns * self._column_count
        block = _SETTINGS.block_rows * max(self._camera.panel.shape[0], columns)
        return 16 * (held + 3 * block + (self._kernel_count if self._keeps_kernels else 0))

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        rows, columns = self._camera.panel.shape
        width, nodes = self._column_count, self._integrals.nodes
        height, across = self._request.samples.shape
        each = columns * (width + nodes) + nodes * (across + self._lens_wave.terms)
        arriving = self._row_count if self._keeps_rows else self._end_count
        products = arriving * rows * columns + self._row_count * across * height
        products += self._end_count * each + self._integrals.node_count * columns * width
        seconds = _SETTINGS.product_cost * products * speed.multiply_add
        seconds += _SETTINGS.piece_calls * (3 + self._integrals.pieces) * speed.call
        return seconds + (0.0 if self._keeps_kernels else self._kernel_seconds(speed))

    def _kernel_seconds(self, speed: MachineSpeed) -> float:
        return _SETTINGS.kernel_cost * self._kernel_count * speed.bessel

    def planning_seconds(self, speed: MachineSpeed) -> float:
        seconds = super().planning_seconds(speed) + _SETTINGS.planning_calls * speed.call
        if not self.error.value + self.arithmetic <= self._request.tol:
            seconds += self.cpu_seconds(speed)
        return seconds + (self._kernel_seconds(speed) if self._keeps_kernels else 0.0)

    def prepare(self) -> None:
        n, slopes = self._request.numeric, self._slopes
        self._rows = quadrature_rows(self._bands, slopes[0], slopes[1], _SETTINGS.quadrature_tol)
        self._integrals.prepare(self._rows.end)
        self._lens_wave.prepare()
        if self._keeps_kernels:
            self._kept = list(self._row_kernels()), list(self._piece_kernels())
        if not self.error.value + self.arithmetic <= n.tol:
            # The light that the edge of the stop sends to a dark window isn't known beforehand.
            with torch.no_grad():
                self.intensity(None, None)
            self._planned_error = self.error

    def _row_kernels(self) -> Iterator[torch.Tensor]:
        """Yield the fields of the panel's rows of pixels at rows of the stop, (rows, pixels)."""
        assert self._rows is not None
        y = torch.from_numpy(self._rows.y)
        for start in range(0, len(y), _SETTINGS.block_rows):
            yield self._pixel_fields(0, y[start : start + _SETTINGS.block_rows])

    def _piece_kernels(self) -> Iterator[torch.Tensor]:
        """Yield the fields of the panel's columns at the nodes of each piece, (nodes, pixels)."""
        for piece in range(self._integrals.pieces):
            yield self._pixel_fields(1, self._integrals.places(piece))

    def _pixel_fields(self, axis: int, place: torch.Tensor) -> torch.Tensor:
        """Return the fields along an axis that the panel's pixels send to places at the lens.

        place: in stop radii.
        """
        area = torch.tensor(self._area, dtype=torch.float64)
        return cell_kernel(self._offsets(axis, place), self._camera.panel.active_side, area)

    def _offsets(self, axis: int, place: torch.Tensor) -> torch.Tensor:
        """Return metres along an axis from the panel's pixels to places at the chain's lens."""
        n = self._request.numeric
        shift = float(n.chief_ray_slopes[axis]) * n.separation
        arriving = place * (n.radius / float(n.shadow_magnification)) - shift
        return arriving[:, None] - self._camera.panel.plane.coordinates(axis)

    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor:
        modulated = self.panel_field(phase, amplitude)
        if not modulated.numel():
            return self.empty_intensity(modulated)
        field = self._field_at_sensor(modulated.cpu()).to(modulated.device)
        light = (field.real**2 + field.imag**2) * self._intensity_factor
        self._tell_error(modulated.detach().cpu(), field.detach().cpu(), added)
        return light

    def _tell_error(
        self, modulated: torch.Tensor, field: torch.Tensor, added: AddedLight | None
    ) -> None:
        """Tell the chain's error for the light in the window; raise ToleranceError if it's large.

        An error e of the field changes its intensity by 2 |field| e, and the L2 norm of the
        intensity is at least the light over the root of the number of samples.
        """
        window = self._request.window_slices
        seen = window_norm(field.abs(), window)
        count = math.prod(part.stop - part.start for part in window)
        wrong = 2 * math.sqrt(count) * self._stop_light.error(modulated)
        self._own_error = largest_ratio(wrong, seen) + self.arithmetic
        light = self._intensity_factor * (field.real**2 + field.imag**2)
        norm = window_norm(light, window)
        error = error_beside(self._own_error, norm, added)
        self.error = ErrorEstimate(
            max(error - self.arithmetic, 0.0),
            "estimate of rounding, for the light in the window",
        )
        if not error <= self._promised_tol:
            allowed_own_error(self._promised_tol, norm, added)
            raise unreachable_tolerance_error(self._promised_tol, error)

    def _field_at_sensor(self, modulated: torch.Tensor) -> torch.Tensor:
        """Compute the chain's field at the sensor, (..., rows, columns), in square stop radii."""
        assert self._rows is not None
        rows = self._rows
        sent: torch.Tensor | None = None
        if self._keeps_rows:
            kernels = self._kept[0] if self._kept else self._row_kernels()
            sent = torch.cat([kernel @ modulated for kernel in kernels], dim=-2)
        size = (*modulated.shape[:-2], len(rows.y), self._request.samples.shape[1])
        found = modulated.new_zeros(size)
        row, sign = torch.from_numpy(rows.row), torch.from_numpy(rows.sign)[:, None]
        along_y = self._lens_wave.along(0, torch.from_numpy(rows.y))
        along_y = along_y * torch.from_numpy(rows.weight)[:, None]
        before = along_y.new_zeros(modulated.shape[-1], along_y.shape[1] * size[-1])
        for piece, kernel in enumerate(self._kept[1] if self._kept else self._piece_kernels()):
            place = self._integrals.places(piece)
            lens, sensor = self._lens_wave.along(1, place), self._sensor_kernel(1, place)
            ends, partial = self._integrals.ends(piece)
            chosen = row[ends]
            left = along_y[chosen] * sign[ends]
            if sent is None:
                y = torch.from_numpy(rows.y[rows.row[ends.numpy()]])
                arriving = self._pixel_fields(0, y) @ modulated
            else:
                arriving = sent.index_select(-2, chosen)
            here = ((arriving @ kernel.mT) * (partial * (left @ lens.mT))) @ sensor
            whole = arriving @ before
            whole = whole.reshape(*whole.shape[:-1], lens.shape[1], sensor.shape[1])
            found.index_add_(-2, chosen, here + (whole * left[:, :, None]).sum(-2))
            columns = (lens[:, :, None] * sensor[:, None, :]).flatten(1)
            before = before + (kernel * self._integrals.weights[:, None]).mT @ columns
        return torch.cat([part @ found for part in self._sensor_rows()], dim=-2)

    def _sensor_rows(self) -> Iterator[torch.Tensor]:
        """Yield the kernel of some rows at the sensor at a time, (rows, rows of the stop)."""
        assert self._rows is not None
        y, rows = torch.from_numpy(self._rows.y), self._request.samples.shape[0]
        some = max(1, _SETTINGS.block_rows * 256 // len(y))
        for start in range(0, rows, some):
            yield self._sensor_kernel(0, y, slice(start, start + some)).mT

    def _sensor_kernel(
        self, axis: int, place: torch.Tensor, part: slice = slice(None)
    ) -> torch.Tensor:
        """Return the Fourier kernel from places in the stop to samples, (places, samples)."""
        n = self._request.numeric
        turns = torch.outer(place, n.samples.coordinates(axis)[part]) * (-n.radius / n.scale)
        return unit_phasor(turns, torch.complex128)


class _StopLight:
    """Samples a chain's light in the stop, and estimates the rounding of its integral.

    A pixel's field in the stop is known to some roundings of its value and of its phase in radians;
    these errors are independent from row to row, or from node to node. Sums of products are known
    to some roundings of their value. By Schwarz' inequality, the integral of an error over the stop
    is at most the root of the stop's area times that of its mean square.
    """

    def __init__(self, engine: DirectEngine, spans: Sequence[tuple[float, float]]) -> None:
        n = engine._request.numeric
        share = (np.arange(_SETTINGS.probes) + 0.5) * (math.sqrt(5) - 1) / 2 % 1
        places = [torch.from_numpy(low + (high - low) * share) for low, high in spans]
        self._fields = [engine._pixel_fields(axis, place) for axis, place in enumerate(places)]
        self._light, self._noise = [], []
        for axis, field in enumerate(self._fields):
            light = field.real**2 + field.imag**2
            turns = engine._offsets(axis, places[axis]) ** 2 / (2 * engine._area)
            self._light.append(light.mean(0))
            independent = (engine._row_count, engine._integrals.node_count)[axis]
            self._noise.append((light * (1 + math.pi * turns) ** 2).mean(0) / independent)
        box = math.prod(high - low for low, high in spans)
        rounding = _SETTINGS.roundings * float(np.finfo(np.float64).eps)
        self._scale = rounding * math.sqrt(n.lens.stop.area * box)

    @property
    def even_error(self) -> float:
        """The error of the field at a sample of the chain's sensor, for an evenly lit panel."""
        (y, x), (down, along) = (tuple(map(torch.sum, one)) for one in (self._light, self._noise))
        return self._scale * float((y * x).sqrt() + (down * x + y * along).sqrt())

    def error(self, modulated: torch.Tensor) -> torch.Tensor:
        """Estimate the error of the field at a sample of a chain's sensor, (...), float64."""
        y, x = self._fields
        field = y @ modulated @ x.mT
        light = (field.real**2 + field.imag**2).mean((-2, -1))
        power = modulated.real**2 + modulated.imag**2
        (here, there), (down, along) = self._light, self._noise
        noise = (power @ there) @ down + (power @ along) @ here
        return self._scale * (light.sqrt() + noise.sqrt())
