"""What all angular-spectrum methods share."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import scipy.fft
import torch

from optics.accuracy import FLOAT64_ARITHMETIC, MachineSpeed, ToleranceError, require_memory
from optics.fourier import CommensurateTransform, FourierGeometry, plan_transform, unit_phasor
from optics.fourier.differentiation import apply_linear_map
from optics.fourier.gridded import FINEST_GRIDDING
from optics.fourier.transform import RETAINED_BYTES, PlaneTransform
from optics.plane import Plane
from optics.propagation.band import FrequencyBand, target_band
from optics.propagation.paraxial import paraxial_model_error
from optics.propagation.propagator import FIELD32_ARITHMETIC, Propagator, Share
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.transfer_function import free_space_transfer_function
from optics.validation import as_number, needs_gradient

# Largest relative error for which a band or a transform is planned. Chosen, because the error
# estimates hold only for small errors.
_LARGEST_ERROR = 0.1

_BLOCK_SIZE = 1 << 18  # frequencies whose transfer function is computed at once. Chosen.

# Memory in bytes per frequency while the transfer function is computed; the second where
# derivatives are recorded.
_BYTES_PER_FREQUENCY, _RECORDED_BYTES = 64, 160

# Processor time per frequency of the transfer function, in passes over one complex number.
_TOUCHES_PER_FREQUENCY = 250

_PLANNING_CALLS = 6  # processor time of planning the two transforms, in function calls

# Samples of a period from which on no FFT-friendly length is searched. Chosen.
_LONGEST_FFT_SEARCH = 1 << 40

# Most parts into which a spectrum that doesn't fit in memory is split. Chosen, because more parts
# would spend their time at the edges.
_MAX_PARTS = 64


class SpectrumPart(NamedTuple):
    """Some rows of the spectrum, with the transforms from the source to it and on to the target."""

    frequencies: Plane
    to_spectrum: PlaneTransform
    to_target: PlaneTransform


class SpectralPropagator(Propagator):
    """Propagate a field by its spectrum, multiplied by the transfer function of free space.

        U(x) = sum over f of W(f) A(f) exp(2 pi i f.x), W = area E t H df_y df_x,

    where E is the envelope of a cell, t the taper and H the transfer function of free space (see
    optics.propagation.band for t and df). Both sums are Fourier transforms of optics.fourier; the
    second is conj(T conj), with T from the frequencies to the target. A spectrum that doesn't fit
    in memory is computed and used some rows at a time.
    """

    search_calls = 8

    paraxial = False
    """Whether the method's transfer function is Fresnel's."""

    commensurate = False
    """Whether FFTs between planes of commensurate pitches are used, instead of the cheapest
    transforms."""

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        self._require_applicable()
        n = self._numeric_span = span.numeric
        self.band = self._build_band()
        model = (
            paraxial_model_error(n, self.band.largest_target_frequency) if self.paraxial else 0.0
        )
        if n.tol * (1 - Share.SPECTRAL) - model >= FIELD32_ARITHMETIC:
            self.dtype, self.arithmetic = torch.complex64, FIELD32_ARITHMETIC
        else:
            # The rounding error grows with the largest phase.
            turns = abs(n.distance) * n.wavelength * self.band.largest_frequency**2
            self.dtype, self.arithmetic = torch.complex128, FLOAT64_ARITHMETIC + 1e-15 * turns
        self._parts: list[SpectrumPart] = []
        sampling = self.band.epsilon + model + self._plan()
        self._set_error_bound(sampling, Share.SPECTRAL, model)
        rows, columns = self.frequencies.shape
        parts = f" in {len(self._parts)} parts" if len(self._parts) > 1 else ""
        self.sampling = f"{columns}x{rows} frequencies{parts}"
        # Errors of the samples and of the spectrum spread over the period of the replicas.
        for axis in (0, 1):
            width = n.target.shape[axis] * n.target.pitch[axis]
            self.rounding_share *= min(width * self.frequencies.pitch[axis], 1.0)
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
        n = self._numeric_span
        lost = min(Share.BAND * n.sampling_tol, _LARGEST_ERROR)
        return target_band(
            n if n.paraxial == self.paraxial else replace(n, paraxial=self.paraxial), lost
        )

    def _candidate_pitches(self) -> list[tuple[float, float]]:
        """Return the pitches (y, x) in metres for which a plan is tried.

        The period of the replicas is made a multiple of the pitch, which allows FFTs.
        """
        return [self._numeric_span.source.pitch]

    def _plan(self) -> float:
        """Plan the transforms for the cheapest period of replicas, and return their error.

        The spectrum is split into as few parts of whole rows as fit in memory.
        """
        least, refusals, speed = math.inf, [], self._numeric_span.budget.speed
        for pitches in self._candidate_pitches():
            try:
                frequencies = self._frequencies(pitches)
                rows, columns = frequencies.shape
                most = 1 if self.span.differentiable else min(_MAX_PARTS, rows)
                # This refuses what can't fit before any transform is planned.
                self._require_memory(3 * self.dtype.itemsize * (float(rows) * columns / most))
                count = 1
                while True:
                    step = -(-rows // count)
                    try:
                        parts = [self._build_part(frequencies, 0, step)]
                        self._require_memory(self._part_bytes(parts[0]))
                        break
                    except ToleranceError:
                        if count == most:
                            raise
                        count = min(2 * count, most)
                for start in range(step, rows, step):
                    parts.append(self._build_part(frequencies, start, start + step))
            except ToleranceError as error:
                refusals.append(error)
                continue
            seconds = self._transforms_seconds(parts, speed)
            if seconds < least:
                least, self.frequencies, self._parts = seconds, frequencies, parts
        if not self._parts:
            raise refusals[0]
        return max(part.to_spectrum.error + part.to_target.error for part in self._parts)

    def _frequencies(self, pitches: tuple[float, float]) -> Plane:
        """Return the plane of frequencies; its period is a multiple of the pitches."""
        shape, pitch, centre = [], [], []
        for axis, least, unit in zip(self.band.axes, self.band.period, pitches, strict=True):
            length = max(math.ceil(least / unit * (1 - 1e-12)), 1)
            samples = (axis.high - axis.low) * length * unit
            self._require_memory(samples * 3 * self.dtype.itemsize)
            fast = length < _LONGEST_FFT_SEARCH
            period = (scipy.fft.next_fast_len(length) if fast else length) * unit
            count = self._count((axis.high - axis.low) * period)
            shape.append(count)
            pitch.append(1 / period)
            # This centres the samples, which begin at index -(count // 2), in the band.
            centre.append((axis.low + axis.high + (1 - count % 2) / period) / 2)
        return Plane((shape[0], shape[1]), (pitch[0], pitch[1]), (centre[0], centre[1]))

    def _count(self, steps: float) -> int:
        return math.floor(steps * (1 - 1e-12)) + 1

    def _require_memory(self, least: float) -> None:
        """Raise ToleranceError if `least` bytes are more than the budget allows."""
        remedy = "ask for a smaller target or a larger tol"
        require_memory(self.name, least, self._numeric_span.budget.memory, remedy)

    def _build_part(self, plane: Plane, first: int, last: int) -> SpectrumPart:
        """Plan a spectrum from row `first` up to, not including, `last`."""
        n, rows = self._numeric_span, min(last, plane.shape[0]) - first
        place = plane.centre[0] + (first + rows // 2 - plane.shape[0] // 2) * plane.pitch[0]
        part = Plane((rows, plane.shape[1]), plane.pitch, (place, plane.centre[1]))
        there, back = FourierGeometry(n.source, part, 1.0), FourierGeometry(part, n.target, 1.0)
        if self.commensurate:
            return SpectrumPart(
                part,
                CommensurateTransform(there, self.dtype),
                CommensurateTransform(back, self.dtype),
            )
        error = transform_error_share(n)
        return SpectrumPart(
            part,
            plan_transform(there, self.dtype, n.budget, error=error),
            plan_transform(back, self.dtype, n.budget, error=error),
        )

    def _part_bytes(self, part: SpectrumPart) -> int:
        return max(part.to_spectrum.bytes, part.to_target.bytes) + self._filter_bytes(
            part.frequencies
        )

    @property
    def bytes(self) -> int:
        return max(map(self._part_bytes, self._parts))

    def _filter_bytes(self, frequencies: Plane) -> int:
        """Return the bytes of the transfer function, the spectrum and their product."""
        rows, columns = frequencies.shape
        block = max(min(rows * columns, _BLOCK_SIZE), columns)
        making = _BYTES_PER_FREQUENCY * block
        if self.span.differentiable:
            making = _RECORDED_BYTES * rows * columns
        return making + 4 * rows * columns * self.dtype.itemsize

    @staticmethod
    def _transforms_seconds(parts: list[SpectrumPart], speed: MachineSpeed) -> float:
        seconds = 0.0
        for part in parts:
            seconds += part.to_spectrum.cpu_seconds(speed)
            seconds += part.to_target.cpu_seconds(speed)
        return seconds

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._transforms_seconds(self._parts, speed) + self._filter_seconds(speed)

    @property
    def _rebuilds_filter(self) -> bool:
        """Whether each call recomputes W, for derivatives or a spectrum too large for memory."""
        return len(self._parts) > 1 or self.span.differentiable

    def _filter_seconds(self, speed: MachineSpeed) -> float:
        rows, columns = self.frequencies.shape
        making = _TOUCHES_PER_FREQUENCY if self._rebuilds_filter else 0
        touches = 3 * speed.slowdown(self.dtype) + making
        first = self._parts[0].frequencies if self._parts else self.frequencies
        taken = max(len(self._parts), 1) * max(self._filter_bytes(first) - RETAINED_BYTES, 0)
        return touches * rows * columns * speed.touch + taken * speed.fresh

    def planning_seconds(self, speed: MachineSpeed) -> float:
        transforms = 0.0
        for part in self._parts:
            transforms += part.to_spectrum.planning_seconds(speed)
            transforms += part.to_target.planning_seconds(speed)
        seconds = _PLANNING_CALLS * speed.call + transforms
        if self._rebuilds_filter:
            return seconds
        return seconds + _TOUCHES_PER_FREQUENCY * self._filter_size * speed.touch

    @property
    def _filter_size(self) -> int:
        """The number of transfer functions that the filter W takes."""
        return math.prod(self.frequencies.shape)

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
        rows, columns = frequencies.shape
        step = rows if self.span.differentiable else max(_BLOCK_SIZE // columns, 1)
        parts = []
        for first in range(0, rows, step):
            block = slice(first, first + step)
            part = self._transfer(y[block], x) * (down[block] * along)
            if self.band.radial:
                part = part * self.band.radial(torch.sqrt(y[block] ** 2 + x**2))
            parts.append(part.to(self.dtype))
        return parts[0] if len(parts) == 1 else torch.cat(parts)

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
            return self._sum_parts(field)
        return apply_linear_map(self._sum_parts, self.adjoint, field)

    def _sum_parts(self, field: torch.Tensor) -> torch.Tensor:
        answer: torch.Tensor | None = None
        for frequencies, to_spectrum, to_target in self._parts:
            spectrum = self._apply_filter(to_spectrum(field), frequencies)
            found = _conjugate(to_target(_conjugate(spectrum)))
            answer = found if answer is None else answer.add_(found)
        assert answer is not None
        return answer

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        answer: torch.Tensor | None = None
        for frequencies, to_spectrum, to_target in self._parts:
            spectrum = to_target.adjoint(field.to(self.dtype).conj()).conj()
            found = to_spectrum.adjoint(self._apply_filter(spectrum, frequencies, back=True))
            answer = found if answer is None else answer + found
        assert answer is not None
        return answer


def times(spectrum: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Multiply a spectrum by a weight, in place where nothing records derivatives."""
    if spectrum.requires_grad or weight.requires_grad:
        return spectrum * weight
    return spectrum.mul_(weight)


def _conjugate(values: torch.Tensor) -> torch.Tensor:
    """Conjugate values, in place where no derivatives are recorded."""
    return values.conj().resolve_conj() if values.requires_grad else values.conj_physical_()


def transform_error_share(span: FreeSpaceSpan) -> float:
    """Return the relative error that each of the two Fourier transforms may have."""
    return min(max(Share.TRANSFORM * span.sampling_tol, FINEST_GRIDDING), _LARGEST_ERROR)
