"""What all angular-spectrum methods share."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import scipy.fft
import torch

from optics.accuracy import FLOAT64_ARITHMETIC, MachineSpeed, ToleranceError, require_memory
from optics.fourier import FourierGeometry, plan_transform, unit_phasor
from optics.fourier.differentiation import apply_linear_map
from optics.fourier.gridded import FINEST_GRIDDING
from optics.fourier.transform import RETAINED_BYTES, PlaneTransform
from optics.plane import Plane
from optics.propagation.band import FrequencyBand, target_band
from optics.propagation.paraxial import paraxial_model_error
from optics.propagation.propagator import FIELD32_ARITHMETIC, TOLERANCE_SHARES, Propagator
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.transfer_function import free_space_transfer_function
from optics.validation import as_number, needs_gradient


@dataclass(frozen=True)
class SpectralSettings:
    """Tune the angular-spectrum methods.

    largest_error: largest error for which a band or a transform is planned, relative. Chosen,
        because the error estimates hold only for small errors.
    block_size: number of frequencies whose transfer function is computed at once. Chosen.
    bytes_per_frequency: memory in bytes per frequency while the transfer function is computed.
    recorded_bytes: the same in bytes where derivatives are recorded.
    touches_per_frequency: processor time per frequency for computing the transfer function, in
        passes over one complex number.
    planning_calls: processor time of planning the two transforms, in function calls.
    longest_fft_search: length of a period in samples above which no FFT-friendly length is
        searched. Chosen.
    max_parts: largest number of parts into which a spectrum that doesn't fit in memory is split.
        Chosen, because more parts would spend their time at the edges.
    """

    largest_error: float = 0.1
    block_size: int = 1 << 18
    bytes_per_frequency: int = 64
    recorded_bytes: int = 160
    touches_per_frequency: int = 250
    planning_calls: int = 6
    longest_fft_search: int = 1 << 40
    max_parts: int = 64


_SETTINGS = SpectralSettings()


@dataclass(frozen=True)
class SpectrumPart:
    """Some rows of the spectrum, with the transforms from the source to it and on to the target."""

    frequencies: Plane
    to_spectrum: PlaneTransform
    to_target: PlaneTransform

    @property
    def transforms(self) -> tuple[PlaneTransform, PlaneTransform]:
        return self.to_spectrum, self.to_target

    @property
    def bytes(self) -> int:
        return max(transform.bytes for transform in self.transforms)


class SpectralPropagator(Propagator):
    """Propagate a field by its spectrum, multiplied by the transfer function of free space.

        U(x) = sum over f of W(f) A(f) exp(2 pi i f.x), W = area E t H df_y df_x,

    where E is the envelope of a cell, t the taper and H the transfer function of free space (see
    optics.propagation.band for t and df). Both sums are Fourier transforms of optics.fourier; the
    second is conj(T conj), with T from the frequencies to the target. A spectrum that doesn't fit
    in memory is computed and used some rows at a time.
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
        share = TOLERANCE_SHARES.spectral
        spare = n.tol * (1 - share) - model
        single = spare >= FIELD32_ARITHMETIC
        self.dtype = torch.complex64 if single else torch.complex128
        self.arithmetic = FIELD32_ARITHMETIC if single else self._double_arithmetic()
        self._plan()
        sampling = self.band.epsilon + model + self._transform_error()
        self._set_error_bound(sampling, share, model)
        rows, columns = self.frequencies.shape
        parts = f" in {len(self._parts)} parts" if len(self._parts) > 1 else ""
        self.sampling = f"{columns}x{rows} frequencies{parts}"
        self._cached_filter: torch.Tensor | None = None

    def _require_applicable(self) -> None:
        """Raise ValueError if this method isn't valid for the span."""
        self._require_parallel()
        if self.span.paraxial and not self.paraxial:
            raise ValueError(f"{self.name} computes the scalar model: paraxial=False")

    def _build_band(self) -> FrequencyBand:
        """Return the band of frequencies whose rays reach the target.

        Raises ToleranceError if some rays are grazing.
        """
        return target_band(replace(self._numeric_span, paraxial=self.paraxial), self._band_loss())

    def _candidate_pitches(self) -> list[tuple[float, float]]:
        """Return the pitches (y, x) in metres for which a plan is tried.

        The period of the replicas is made a multiple of the pitch, which allows FFTs.
        """
        return [self._numeric_span.source.pitch]

    def _transform(self, geometry: FourierGeometry) -> PlaneTransform:
        return cheapest_transform(geometry, self.dtype, self.span)

    def _band_loss(self) -> float:
        """Return the share of the source's light that the band may lose."""
        return min(TOLERANCE_SHARES.band * self._numeric_span.sampling_tol, _SETTINGS.largest_error)

    def _double_arithmetic(self) -> float:
        """Return the relative rounding error in complex128, which grows with the largest phase."""
        n = self._numeric_span
        turns = abs(n.distance) * n.wavelength * self.band.largest_frequency**2
        return FLOAT64_ARITHMETIC + 1e-15 * turns

    def _transform_error(self) -> float:
        """Return the error of the two Fourier transforms, without rounding."""
        return max(stage.to_spectrum.error + stage.to_target.error for stage in self._parts)

    def _plan(self) -> None:
        """Choose the cheapest period of replicas, and plan the transforms for it."""
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
        return sum(t.cpu_seconds(speed) for s in stages for t in s.transforms)

    def _frequencies(self, pitches: tuple[float, float]) -> Plane:
        """Return the plane of frequencies; its period is a multiple of the pitches."""
        shape, pitch, centre = [], [], []
        for axis, least, unit in zip(self.band.axes, self.band.period, pitches, strict=True):
            length = max(math.ceil(least / unit * (1 - 1e-12)), 1)
            self._require_memory((axis.high - axis.low) * length * unit)
            fast = length < _SETTINGS.longest_fft_search
            period = (scipy.fft.next_fast_len(length) if fast else length) * unit
            count = self._count((axis.high - axis.low) * period)
            shape.append(count)
            pitch.append(1 / period)
            # This centres the samples, which begin at index -(count // 2), in the band.
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
        """Split the spectrum into as few parts of whole rows as fit in memory."""
        rows, columns = frequencies.shape
        most = 1 if self.span.differentiable else min(_SETTINGS.max_parts, rows)
        # This refuses what can't fit before any transform is planned.
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
        """Plan the first rows of the spectrum; None if they don't fit in memory.

        last: whether this is the last attempt, which raises ToleranceError instead.
        """
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
        """Return the bytes of the transfer function, the spectrum and their product."""
        rows, columns = frequencies.shape
        block = max(min(rows * columns, _SETTINGS.block_size), columns)
        making = _SETTINGS.bytes_per_frequency * block
        if self.span.differentiable:
            making = _SETTINGS.recorded_bytes * rows * columns
        return making + 4 * rows * columns * self.dtype.itemsize

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        steps = sum(t.cpu_seconds(speed) for s in self._parts for t in s.transforms)
        return steps + self._filter_seconds(speed)

    @property
    def _rebuilds_filter(self) -> bool:
        """Whether each call recomputes W, for derivatives or a spectrum too large for memory."""
        return self.span.differentiable or len(self._parts) > 1

    def _filter_seconds(self, speed: MachineSpeed) -> float:
        rows, columns = self.frequencies.shape
        making = _SETTINGS.touches_per_frequency if self._rebuilds_filter else 0
        touches = 3 * self._slowness(speed) + making
        planes = [stage.frequencies for stage in self._parts] or [self.frequencies]
        taken = len(planes) * max(self._filter_bytes(planes[0]) - RETAINED_BYTES, 0) * speed.fresh
        return touches * rows * columns * speed.touch + taken

    @property
    def rounding_share(self) -> float:
        # Errors of the samples and of the spectrum spread over the period of the replicas.
        target, df = self._numeric_span.target, self.frequencies.pitch
        spread = zip(target.shape, target.pitch, df, strict=True)
        return math.prod(min(count * pitch * step, 1.0) for count, pitch, step in spread)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        seconds = _SETTINGS.planning_calls * speed.call
        seconds += sum(t.planning_seconds(speed) for s in self._parts for t in s.transforms)
        if self._rebuilds_filter:
            return seconds
        return seconds + _SETTINGS.touches_per_frequency * self._filter_size * speed.touch

    @property
    def _frequency_count(self) -> int:
        return math.prod(self.frequencies.shape)

    @property
    def _filter_size(self) -> int:
        """The number of transfer functions that the filter W takes."""
        return self._frequency_count

    def prepare(self) -> None:
        if not self._rebuilds_filter:
            self._cached_filter = self._build_filter(self.frequencies)

    def _weight(self, frequencies: Plane, axis: int) -> torch.Tensor:
        """Return the factors of the filter W that depend on one axis, float64."""
        n = self._numeric_span
        f = frequencies.coordinates(axis)
        weight = self.band.axes[axis].taper(f) * frequencies.pitch[axis]
        if n.cells is None:
            return weight * n.source.pitch[axis]
        return weight * n.cells[axis] * torch.sinc(f * n.cells[axis])

    def _build_filter(self, frequencies: Plane) -> torch.Tensor:
        """Compute the filter W over a plane of frequencies."""
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
        step = rows if self.span.differentiable else max(_SETTINGS.block_size // columns, 1)
        return (slice(first, first + step) for first in range(0, rows, step))

    def _transfer(self, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        span = self.span
        wave = free_space_transfer_function(
            y, x, span.distance, span.wavelength, paraxial=self.paraxial
        )
        if not any(map(needs_gradient, span.target.centre)):
            return wave
        # The shift is zero, but its derivative is that of a displacement of the target.
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
        """Multiply a spectrum by the filter W, or by its conjugate on the way back."""
        w = self._filter(frequencies, spectrum.device)
        return times(spectrum, w.conj() if back else w)

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


def times(spectrum: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Multiply a spectrum by a weight, in place where nothing records derivatives."""
    if spectrum.requires_grad or weight.requires_grad:
        return spectrum * weight
    return spectrum.mul_(weight)


def _conjugate(values: torch.Tensor) -> torch.Tensor:
    """Conjugate values, in place where no derivatives are recorded."""
    return values.conj().resolve_conj() if values.requires_grad else values.conj_physical_()


def _rows_of(plane: Plane, first: int, last: int) -> Plane:
    """Return the part of a plane from row `first` up to, not including, `last`."""
    rows = min(last, plane.shape[0]) - first
    place = plane.centre[0] + (first + rows // 2 - plane.shape[0] // 2) * plane.pitch[0]
    return Plane((rows, plane.shape[1]), plane.pitch, (place, plane.centre[1]))


def transform_error_share(span: FreeSpaceSpan) -> float:
    """Return the relative error that each of the two Fourier transforms may have."""
    allowed = TOLERANCE_SHARES.transform * span.sampling_tol
    return min(max(allowed, FINEST_GRIDDING), _SETTINGS.largest_error)


def cheapest_transform(
    geometry: FourierGeometry, dtype: torch.dtype, span: FreeSpaceSpan
) -> PlaneTransform:
    """Plan the cheapest Fourier transform between two planes for a span's tolerance."""
    return plan_transform(geometry, dtype, span.numeric.budget, error=transform_error_share(span))
