"""What all ways through the angular spectrum share: source, frequencies, target."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import scipy.fft
import torch

from optics.accuracy import FLOAT64_ARITHMETIC, MachineSpeed, ToleranceError, require_memory
from optics.edge import as_number, recorded
from optics.fourier import Geometry, plan_transform, unit_phasor
from optics.fourier.gridded import FINEST_GRIDDING
from optics.fourier.transform import KEPT_BYTES, PlaneTransform, linear
from optics.plane import Plane
from optics.propagation.band import Band, reaching_band
from optics.propagation.paraxial import paraxial_cost
from optics.propagation.precision import FIELD32_ARITHMETIC
from optics.propagation.propagator import Propagator
from optics.propagation.span import Span
from optics.propagation.transfer import transfer

REACH_SHARE, TRANSFORM_SHARE = 0.4, 0.05
"""Of the tolerance: light that is cut or comes from copies, and each of two transforms."""

_SAMPLING_SHARE = REACH_SHARE + 2 * TRANSFORM_SHARE

COARSEST = 0.1
"""The largest error that anything is made for: estimates hold for small ones."""

_ROWS = 1 << 18
"""Frequencies whose transfer function is made at a time."""

_MAKING_BYTES, _RECORDED_BYTES, _MAKING_TOUCHES = 64, 160, 250
"""Of a frequency's transfer function while it is made, and when it is made for derivatives."""


_FASTEST = 1 << 40
"""Samples of a period beyond which nobody looks for a length that suits an FFT."""

_MOST_STAGES = 64
"""Parts of a spectrum that doesn't fit in memory; more would spend their time at the edges."""


@dataclass(frozen=True)
class Stage:
    """Rows of the frequencies, and the transforms from the source to them and on to the
    target."""

    frequencies: Plane
    there: PlaneTransform
    back: PlaneTransform

    @property
    def bytes(self) -> int:
        return max(self.there.bytes, self.back.bytes)


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

    def __init__(self, span: Span) -> None:
        super().__init__(span)
        self._require_served()
        n = self._declared = span.numeric
        self.band = self._made_band()
        model = paraxial_cost(n, self.band.needed) if self.paraxial else 0.0
        spare = n.tol * (1 - _SAMPLING_SHARE) - model
        single = spare >= FIELD32_ARITHMETIC
        self.dtype = torch.complex64 if single else torch.complex128
        self.arithmetic = FIELD32_ARITHMETIC if single else self._double_arithmetic()
        self._plan()
        sampling = self.band.epsilon + model + self._transform_error()
        self._promise(sampling, _SAMPLING_SHARE, model)
        rows, columns = self.frequencies.shape
        parts = f" in {len(self._stages)} parts" if len(self._stages) > 1 else ""
        self.sampling = f"{columns}x{rows} frequencies{parts}"
        self._kept: torch.Tensor | None = None

    def _require_served(self) -> None:
        """Raise ValueError for a span that this method isn't made for."""
        self._require_parallel()
        if self.span.paraxial and not self.paraxial:
            raise ValueError(f"{self.name} computes the scalar model: paraxial=False")

    def _made_band(self) -> Band:
        """The frequencies whose rays reach the target; ToleranceError where rays graze."""
        return reaching_band(replace(self._declared, paraxial=self.paraxial), self._epsilon())

    def _pitches(self) -> list[tuple[float, float]]:
        """Metres (y, x) of which the period is made a multiple, for FFTs; one plan for each."""
        return [self._declared.source.pitch]

    def _transform(self, geometry: Geometry) -> PlaneTransform:
        return any_transform(geometry, self.dtype, self.span)

    def _epsilon(self) -> float:
        """What the band may lose."""
        return min(REACH_SHARE * self._declared.tol, COARSEST)

    def _double_arithmetic(self) -> float:
        """A phase of so many radians keeps no more digits than double precision leaves it."""
        n = self._declared
        turns = abs(n.distance) * n.wavelength * self.band.farthest**2
        return FLOAT64_ARITHMETIC + 1e-15 * turns

    def _transform_error(self) -> float:
        """Of the transforms to the frequencies and back, beyond rounding."""
        return max(stage.there.error + stage.back.error for stage in self._stages)

    def _plan(self) -> None:
        """The cheapest period that serves, and the transforms from source to target by it."""
        plans: list[tuple[float, Plane, list[Stage]]] = []
        refusals: list[ToleranceError] = []
        for pitches in self._pitches():
            try:
                frequencies = self._frequencies(pitches)
                stages = self._staged(frequencies)
            except ToleranceError as error:
                refusals.append(error)
                continue
            plans.append((self._seconds(stages), frequencies, stages))
        if not plans:
            raise refusals[0]
        _, self.frequencies, self._stages = min(plans, key=lambda plan: plan[0])

    def _seconds(self, stages: list[Stage]) -> float:
        speed = self._declared.budget.speed
        return sum(t.cpu_seconds(speed) for s in stages for t in (s.there, s.back))

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
        require_memory(self.name, least, self._declared.budget.memory, remedy)

    def _staged(self, frequencies: Plane) -> list[Stage]:
        """All of them at once if they fit, or so many rows at a time that they do."""
        rows, columns = frequencies.shape
        most = 1 if self.span.differentiable else min(_MOST_STAGES, rows)
        # What can't fit is told before any transform is looked for.
        self._require_memory(float(rows) * columns / most)
        parts, first = 1, self._fitting(frequencies, rows, most == 1)
        while first is None:
            parts = min(2 * parts, most)
            first = self._fitting(frequencies, -(-rows // parts), parts == most)
        step = -(-rows // parts)
        starts = range(step, rows, step)
        return [first] + [self._stage(_rows_of(frequencies, at, at + step)) for at in starts]

    def _fitting(self, frequencies: Plane, rows: int, last: bool) -> Stage | None:
        """The stage of the first rows; None if it doesn't fit in memory, an error if it's the
        last try."""
        try:
            stage = self._stage(_rows_of(frequencies, 0, rows))
        except ToleranceError:
            if last:
                raise
            return None
        needed = stage.bytes + self._filter_bytes(stage.frequencies)
        if last:
            self._require_bytes(needed)
        return stage if needed <= self.span.budget.memory else None

    def _stage(self, frequencies: Plane) -> Stage:
        n = self._declared
        there = self._transform(Geometry(n.source, frequencies, 1.0))
        return Stage(frequencies, there, self._transform(Geometry(frequencies, n.target, 1.0)))

    @property
    def bytes(self) -> int:
        return max(stage.bytes + self._filter_bytes(stage.frequencies) for stage in self._stages)

    def _filter_bytes(self, frequencies: Plane) -> int:
        """Of the transfer function, the spectrum and what comes of it."""
        rows, columns = frequencies.shape
        making = _MAKING_BYTES * max(min(rows * columns, _ROWS), columns)
        if self.span.differentiable:
            making = _RECORDED_BYTES * rows * columns
        return making + 4 * rows * columns * self.dtype.itemsize

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        steps = sum(t.cpu_seconds(speed) for s in self._stages for t in (s.there, s.back))
        return steps + self._filter_seconds(speed)

    @property
    def _remade(self) -> bool:
        """Whether W is made in every call: for its derivatives, or for want of memory."""
        return self.span.differentiable or len(self._stages) > 1

    def _filter_seconds(self, speed: MachineSpeed) -> float:
        rows, columns = self.frequencies.shape
        touches = 3 * self._slowness(speed) + (_MAKING_TOUCHES if self._remade else 0)
        planes = [stage.frequencies for stage in self._stages] or [self.frequencies]
        taken = len(planes) * max(self._filter_bytes(planes[0]) - KEPT_BYTES, 0) * speed.fresh
        return touches * rows * columns * speed.touch + taken

    def prepare(self) -> None:
        if not self._remade:
            self._kept = self._made_filter(self.frequencies)

    def _weight(self, frequencies: Plane, axis: int) -> torch.Tensor:
        """Everything of W that belongs to one axis, float64."""
        n = self._declared
        f = frequencies.coordinates(axis)
        weight = self.band.axes[axis].taper(f) * frequencies.pitch[axis]
        if n.cells is None:
            return weight * n.source.pitch[axis]
        return weight * n.cells[axis] * torch.sinc(f * n.cells[axis])

    def _made_filter(self, frequencies: Plane) -> torch.Tensor:
        """W, over a plane of frequencies."""
        y, x = frequencies.mesh()
        down, along = self._weight(frequencies, 0)[:, None], self._weight(frequencies, 1)
        radial, parts = self.band.radial, []
        for rows in self._blocks(frequencies):
            part = self._transfer(y[rows], x) * (down[rows] * along)
            if radial:
                part = part * radial(torch.sqrt(y[rows] ** 2 + x**2))
            parts.append(part.to(self.dtype))
        return parts[0] if len(parts) == 1 else torch.cat(parts)

    def _blocks(self, frequencies: Plane) -> Iterator[slice]:
        rows, columns = frequencies.shape
        step = rows if self.span.differentiable else max(_ROWS // columns, 1)
        return (slice(first, first + step) for first in range(0, rows, step))

    def _transfer(self, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        span = self.span
        wave = transfer(y, x, span.distance, span.wavelength, paraxial=self.paraxial)
        if not any(map(recorded, span.target.centre)):
            return wave
        # Nothing, whose derivative is that of a move of the target.
        way_y, way_x = (c - as_number(c) for c in span.target.centre)
        return wave * unit_phasor(y * way_y + x * way_x, torch.complex128)

    def _filter(self, frequencies: Plane, device: torch.device) -> torch.Tensor:
        if self._remade:
            return self._made_filter(frequencies).to(device)
        if self._kept is None:
            self.prepare()
        assert self._kept is not None
        if self._kept.device != device:
            self._kept = self._kept.to(device)
        return self._kept

    def _filtered(
        self, spectrum: torch.Tensor, frequencies: Plane, *, back: bool = False
    ) -> torch.Tensor:
        """Times W, or its conjugate on the way back."""
        w = self._filter(frequencies, spectrum.device)
        return _times(spectrum, w.conj() if back else w)

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        if len(self._stages) == 1:
            return self._through(self._stages[0], field)
        return linear(self._summed, self.adjoint, field)

    def _summed(self, field: torch.Tensor) -> torch.Tensor:
        answer = self._through(self._stages[0], field)
        for stage in self._stages[1:]:
            answer += self._through(stage, field)
        return answer

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        answer = self._backwards(self._stages[0], field)
        for stage in self._stages[1:]:
            answer = answer + self._backwards(stage, field)
        return answer

    def _through(self, stage: Stage, field: torch.Tensor) -> torch.Tensor:
        spectrum = self._filtered(stage.there(field), stage.frequencies)
        return _conjugate(stage.back(_conjugate(spectrum)))

    def _backwards(self, stage: Stage, field: torch.Tensor) -> torch.Tensor:
        spectrum = stage.back.adjoint(field.to(self.dtype).conj()).conj()
        return stage.there.adjoint(self._filtered(spectrum, stage.frequencies, back=True))


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


def shared_error(span: Span) -> float:
    """What each of two transforms may add, of the tolerance."""
    return min(max(TRANSFORM_SHARE * span.tol, FINEST_GRIDDING), COARSEST)


def any_transform(geometry: Geometry, dtype: torch.dtype, span: Span) -> PlaneTransform:
    """The cheapest of all transforms between two planes."""
    return plan_transform(geometry, dtype, span.numeric.budget, error=shared_error(span))
