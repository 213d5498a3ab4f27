"""What all ways through the angular spectrum share: source, frequencies, target."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import scipy.fft
import torch

from optics.accuracy import FLOAT64_ARITHMETIC, MachineSpeed, ToleranceError, require_memory
from optics.fourier import FourierGeometry, plan_transform, unit_phasor
from optics.fourier.gridded import FINEST_GRIDDING
from optics.fourier.transform import RETAINED_BYTES, PlaneTransform, apply_linear_map
from optics.plane import Plane
from optics.propagation.band import FrequencyBand, target_band
from optics.propagation.paraxial import paraxial_model_error
from optics.propagation.precision import FIELD32_ARITHMETIC
from optics.propagation.propagator import Propagator
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.transfer_function import free_space_transfer_function
from optics.validation import as_number, needs_gradient

BAND_SHARE, TRANSFORM_SHARE = 0.4, 0.05
"""Of the tolerance: light that is cut or comes from copies, and each of two transforms."""

_SAMPLING_SHARE = BAND_SHARE + 2 * TRANSFORM_SHARE

LARGEST_ERROR = 0.1
"""The largest error that anything is made for: estimates hold for small ones."""

_ROWS = 1 << 18
"""Frequencies whose transfer function is made at a time."""

_MAKING_BYTES, _RECORDED_BYTES, _MAKING_TOUCHES = 64, 160, 250
"""Of a frequency's transfer function while it is made, and when it is made for derivatives."""


_FASTEST = 1 << 40
"""Samples of a period beyond which nobody looks for a length that suits an FFT."""

_MAX_PARTS = 64
"""Parts of a spectrum that doesn't fit in memory; more would spend their time at the edges."""


@dataclass(frozen=True)
class SpectrumPart:
    """Rows of the frequencies, and the transforms from the source to them and on to the
    target."""

    frequencies: Plane
    to_spectrum: PlaneTransform
    to_target: PlaneTransform

    @property
    def bytes(self) -> int:
        return max(self.to_spectrum.bytes, self.to_target.bytes)


class SpectralPropagator(Propagator):
    """From the source to its spectrum, through the transfer function, and on to the target.

        U(x) = sum over f of W(f) A(f) exp(2 pi i f.x), W = area E t H df_y df_x,

    with E the envelope of a cell, t the taper and H the transfer function of free space (see
    optics.propagation.band for t and df). Both sums are Fourier transforms of optics.fourier;
    the second is conj(T conj), with T from the frequencies to the target. A spectrum that
    doesn't fit in memory is made and used some rows at a time.
    """

    paraxial = False
    """Whether the method's transfer function is Fresnel's."""

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        self._require_applicable()
        n = self._numeric_span = span.numeric
        self.band = self._build_band()
        model = (
            paraxial_model_error(n, self.band.largest_target_frequency) if self.paraxial else 0.0
        )
        spare = n.tol * (1 - _SAMPLING_SHARE) - model
        single = spare >= FIELD32_ARITHMETIC
        self.dtype = torch.complex64 if single else torch.complex128
        self.arithmetic = FIELD32_ARITHMETIC if single else self._double_arithmetic()
        self._plan()
        sampling = self.band.epsilon + model + self._transform_error()
        self._set_error_bound(sampling, _SAMPLING_SHARE, model)
        rows, columns = self.frequencies.shape
        parts = f" in {len(self._parts)} parts" if len(self._parts) > 1 else ""
        self.sampling = f"{columns}x{rows} frequencies{parts}"
        self._cached_filter: torch.Tensor | None = None

    def _require_applicable(self) -> None:
        """Raise ValueError for a span that this method isn't made for."""
        self._require_parallel()
        if self.span.paraxial and not self.paraxial:
            raise ValueError(f"{self.name} computes the scalar model: paraxial=False")

    def _build_band(self) -> FrequencyBand:
        """The frequencies whose rays reach the target; ToleranceError where rays graze."""
        return target_band(replace(self._numeric_span, paraxial=self.paraxial), self._band_loss())

    def _candidate_pitches(self) -> list[tuple[float, float]]:
        """Metres (y, x) of which the period is made a multiple, for FFTs; one plan for each."""
        return [self._numeric_span.source.pitch]

    def _transform(self, geometry: FourierGeometry) -> PlaneTransform:
        return cheapest_transform(geometry, self.dtype, self.span)

    def _band_loss(self) -> float:
        """What the band may lose."""
        return min(BAND_SHARE * self._numeric_span.tol, LARGEST_ERROR)

    def _double_arithmetic(self) -> float:
        """A phase of so many radians keeps no more digits than double precision leaves it."""
        n = self._numeric_span
        turns = abs(n.distance) * n.wavelength * self.band.largest_frequency**2
        return FLOAT64_ARITHMETIC + 1e-15 * turns

    def _transform_error(self) -> float:
        """Of the transforms to the frequencies and back, beyond rounding."""
        return max(stage.to_spectrum.error + stage.to_target.error for stage in self._parts)

    def _plan(self) -> None:
        """The cheapest period that serves, and the transforms from source to target by it."""
        plans: list[tuple[float, Plane, list[SpectrumPart]]] = []
        refusals: list[ToleranceError] = []
        for pitches in self._candidate_pitches():
            try:
                frequencies = self._frequencies(pitches)
                stages = self._split_spectrum(frequencies)
            except ToleranceError as error:
                refusals.append(error)
                continue
            plans.append((self._seconds(stages), frequencies, stages))
        if not plans:
            raise refusals[0]
        _, self.frequencies, self._parts = min(plans, key=lambda plan: plan[0])

    def _seconds(self, stages: list[SpectrumPart]) -> float:
        speed = self._numeric_span.budget.speed
        return sum(t.cpu_seconds(speed) for s in stages for t in (s.to_spectrum, s.to_target))

    def _frequencies(self, pitches: tuple[float, float]) -> Plane:
        """The plane of frequencies whose period is a multiple of the pitches."""
        shape, pitch, centre = [], [], []
        for axis, least, unit in zip(self.band.axes, self.band.period, pitches, strict=True):
            length = max(math.ceil(least / unit * (1 - 1e-12)), 1)
            self._require_memory((axis.high - axis.low) * length * unit)
            period = (scipy.fft.next_fast_len(length) if length < _FASTEST else length) * unit
            count = self._count((axis.high - axis.low) * period)
            shape.append(count)
            pitch.append(1 / period)
            # The samples from -(count // 2) on lie evenly in the band.
            centre.append((axis.low + axis.high + (1 - count % 2) / period) / 2)
        return Plane((shape[0], shape[1]), (pitch[0], pitch[1]), (centre[0], centre[1]))

    def _count(self, steps: float) -> int:
        return math.floor(steps * (1 - 1e-12)) + 1

    def _require_memory(self, samples: float) -> None:
        self._require_bytes(samples * 3 * self.dtype.itemsize)

    def _require_bytes(self, least: float) -> None:
        remedy = "ask for a smaller target or a larger tol"
        require_memory(self.name, least, self._numeric_span.budget.memory, remedy)

    def _split_spectrum(self, frequencies: Plane) -> list[SpectrumPart]:
        """All of them at once if they fit, or so many rows at a time that they do."""
        rows, columns = frequencies.shape
        most = 1 if self.span.differentiable else min(_MAX_PARTS, rows)
        # What can't fit is told before any transform is looked for.
        self._require_memory(float(rows) * columns / most)
        parts, first = 1, self._first_part_in_memory(frequencies, rows, most == 1)
        while first is None:
            parts = min(2 * parts, most)
            first = self._first_part_in_memory(frequencies, -(-rows // parts), parts == most)
        step = -(-rows // parts)
        starts = range(step, rows, step)
        return [first] + [self._build_part(_rows_of(frequencies, at, at + step)) for at in starts]

    def _first_part_in_memory(
        self, frequencies: Plane, rows: int, last: bool
    ) -> SpectrumPart | None:
        """The stage of the first rows; None if it doesn't fit in memory, an error if it's the
        last try."""
        try:
            stage = self._build_part(_rows_of(frequencies, 0, rows))
        except ToleranceError:
            if last:
                raise
            return None
        needed = stage.bytes + self._filter_bytes(stage.frequencies)
        if last:
            self._require_bytes(needed)
        return stage if needed <= self.span.budget.memory else None

    def _build_part(self, frequencies: Plane) -> SpectrumPart:
        n = self._numeric_span
        there = self._transform(FourierGeometry(n.source, frequencies, 1.0))
        return SpectrumPart(
            frequencies, there, self._transform(FourierGeometry(frequencies, n.target, 1.0))
        )

    @property
    def bytes(self) -> int:
        return max(stage.bytes + self._filter_bytes(stage.frequencies) for stage in self._parts)

    def _filter_bytes(self, frequencies: Plane) -> int:
        """Of the transfer function, the spectrum and what comes of it."""
        rows, columns = frequencies.shape
        making = _MAKING_BYTES * max(min(rows * columns, _ROWS), columns)
        if self.span.differentiable:
            making = _RECORDED_BYTES * rows * columns
        return making + 4 * rows * columns * self.dtype.itemsize

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        steps = sum(t.cpu_seconds(speed) for s in self._parts for t in (s.to_spectrum, s.to_target))
        return steps + self._filter_seconds(speed)

    @property
    def _rebuilds_filter(self) -> bool:
        """Whether W is made in every call: for its derivatives, or for want of memory."""
        return self.span.differentiable or len(self._parts) > 1

    def _filter_seconds(self, speed: MachineSpeed) -> float:
        rows, columns = self.frequencies.shape
        touches = 3 * self._slowness(speed) + (_MAKING_TOUCHES if self._rebuilds_filter else 0)
        planes = [stage.frequencies for stage in self._parts] or [self.frequencies]
        taken = len(planes) * max(self._filter_bytes(planes[0]) - RETAINED_BYTES, 0) * speed.fresh
        return touches * rows * columns * speed.touch + taken

    def prepare(self) -> None:
        if not self._rebuilds_filter:
            self._cached_filter = self._build_filter(self.frequencies)

    def _weight(self, frequencies: Plane, axis: int) -> torch.Tensor:
        """Everything of W that belongs to one axis, float64."""
        n = self._numeric_span
        f = frequencies.coordinates(axis)
        weight = self.band.axes[axis].taper(f) * frequencies.pitch[axis]
        if n.cells is None:
            return weight * n.source.pitch[axis]
        return weight * n.cells[axis] * torch.sinc(f * n.cells[axis])

    def _build_filter(self, frequencies: Plane) -> torch.Tensor:
        """W, over a plane of frequencies."""
        y, x = frequencies.mesh()
        down, along = self._weight(frequencies, 0)[:, None], self._weight(frequencies, 1)
        radial, parts = self.band.radial, []
        for rows in self._row_blocks(frequencies):
            part = self._transfer(y[rows], x) * (down[rows] * along)
            if radial:
                part = part * radial(torch.sqrt(y[rows] ** 2 + x**2))
            parts.append(part.to(self.dtype))
        return parts[0] if len(parts) == 1 else torch.cat(parts)

    def _row_blocks(self, frequencies: Plane) -> Iterator[slice]:
        rows, columns = frequencies.shape
        step = rows if self.span.differentiable else max(_ROWS // columns, 1)
        return (slice(first, first + step) for first in range(0, rows, step))

    def _transfer(self, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        span = self.span
        wave = free_space_transfer_function(
            y, x, span.distance, span.wavelength, paraxial=self.paraxial
        )
        if not any(map(needs_gradient, span.target.centre)):
            return wave
        # Nothing, whose derivative is that of a move of the target.
        way_y, way_x = (c - as_number(c) for c in span.target.centre)
        return wave * unit_phasor(y * way_y + x * way_x, torch.complex128)

    def _filter(self, frequencies: Plane, device: torch.device) -> torch.Tensor:
        if self._rebuilds_filter:
            return self._build_filter(frequencies).to(device)
        if self._cached_filter is None:
            self.prepare()
        assert self._cached_filter is not None
        if self._cached_filter.device != device:
            self._cached_filter = self._cached_filter.to(device)
        return self._cached_filter

    def _apply_filter(
        self, spectrum: torch.Tensor, frequencies: Plane, *, back: bool = False
    ) -> torch.Tensor:
        """Times W, or its conjugate on the way back."""
        w = self._filter(frequencies, spectrum.device)
        return _times(spectrum, w.conj() if back else w)

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        if len(self._parts) == 1:
            return self._forward_part(self._parts[0], field)
        return apply_linear_map(self._sum_parts, self.adjoint, field)

    def _sum_parts(self, field: torch.Tensor) -> torch.Tensor:
        answer = self._forward_part(self._parts[0], field)
        for stage in self._parts[1:]:
            answer += self._forward_part(stage, field)
        return answer

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        answer = self._adjoint_part(self._parts[0], field)
        for stage in self._parts[1:]:
            answer = answer + self._adjoint_part(stage, field)
        return answer

    def _forward_part(self, stage: SpectrumPart, field: torch.Tensor) -> torch.Tensor:
        spectrum = self._apply_filter(stage.to_spectrum(field), stage.frequencies)
        return _conjugate(stage.to_target(_conjugate(spectrum)))

    def _adjoint_part(self, stage: SpectrumPart, field: torch.Tensor) -> torch.Tensor:
        spectrum = stage.to_target.adjoint(field.to(self.dtype).conj()).conj()
        return stage.to_spectrum.adjoint(self._apply_filter(spectrum, stage.frequencies, back=True))


def _times(spectrum: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """The product; in the spectrum's own memory where nobody asks for derivatives."""
    if spectrum.requires_grad or weight.requires_grad:
        return spectrum * weight
    return spectrum.mul_(weight)


def _conjugate(values: torch.Tensor) -> torch.Tensor:
    """In the values' own memory where nobody asks for derivatives."""
    return values.conj().resolve_conj() if values.requires_grad else values.conj_physical_()


def _rows_of(plane: Plane, first: int, last: int) -> Plane:
    """Some rows of a plane."""
    rows = min(last, plane.shape[0]) - first
    place = plane.centre[0] + (first + rows // 2 - plane.shape[0] // 2) * plane.pitch[0]
    return Plane((rows, plane.shape[1]), plane.pitch, (place, plane.centre[1]))


def transform_error_share(span: FreeSpaceSpan) -> float:
    """What each of two transforms may add, of the tolerance."""
    return min(max(TRANSFORM_SHARE * span.tol, FINEST_GRIDDING), LARGEST_ERROR)


def cheapest_transform(
    geometry: FourierGeometry, dtype: torch.dtype, span: FreeSpaceSpan
) -> PlaneTransform:
    """The cheapest of all transforms between two planes."""
    return plan_transform(geometry, dtype, span.numeric.budget, error=transform_error_share(span))
