"""Propagate the field of a panel's pixels through free space to a grid at the lens, by FFTs.

The spectrum of square pixels of uniform modulation is known in closed form at every frequency. Free
space multiplies it by the phase of Fresnel's approximation. Both factor into y and x. So each axis
takes one FFT over the pixels, a product with the transfer function over a band of frequencies, and
one FFT back to the lens grid. Frequencies beyond the panel's Nyquist rate repeat those below it,
under another part of the pixel's envelope. Frequencies beyond the grid's Nyquist rate are folded
into it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import scipy.fft
import torch

from optics.accuracy import MachineSpeed
from optics.fourier import fft, unit_phasor
from optics.fourier.differentiation import Derivatives, ShapedMap, apply_linear_map
from optics.fourier.fft import fft_operations


@dataclass(frozen=True)
class TaperedBand:
    """Holds a band of frequencies along an axis, with smooth ends; all in cycles per metre.

    low, high: where the amplitude has fallen to one half.
    taper_sigma: standard deviation of the Gaussian that smooths the ends.
    taper_sigmas: number of standard deviations beyond low and high at which the amplitude counts as
    zero.
    """

    low: float
    high: float
    taper_sigma: float
    taper_sigmas: float

    @property
    def outer_limits(self) -> tuple[float, float]:
        return (
            self.low - self.taper_sigmas * self.taper_sigma,
            self.high + self.taper_sigmas * self.taper_sigma,
        )

    def taper(self, frequency: torch.Tensor) -> torch.Tensor:
        """Return the amplitude factor of frequencies, 0 to 1, float64."""
        width = math.sqrt(2) * self.taper_sigma
        above = torch.erfc((self.low - frequency) / width)
        below = torch.erfc((frequency - self.high) / width)
        return above * below / 4


@dataclass(frozen=True)
class PropagatorAxis:
    """Describes one axis of a propagator from the panel to samples at the lens; SI units.

    pixel_count, pitch: number of panel pixels and their pitch.
    pixel_side: side of a pixel's active square.
    fft_length: points of the FFT over the panel, which make one period.
    sample_count: samples at the lens.
    folded_length: points of the FFT back to the lens, which make the same period.
    fresnel_area: wavelength times the distance in free space, over the shadow's magnification.
    first_sample_position: position of the first sample, in the panel's coordinates.
    band: frequencies that are propagated.
    shared_range: numbers (first, last) of the frequencies in a spectrum that several propagators
    share; None for the band's own.
    has_pixel_slope: whether the phase across a pixel rises by one cycle per metre, to the first
    order, instead of being constant.
    """

    pixel_count: int
    pitch: float
    pixel_side: float
    fft_length: int
    sample_count: int
    folded_length: int
    fresnel_area: float
    first_sample_position: float
    band: TaperedBand
    shared_range: tuple[int, int] | None = None
    has_pixel_slope: bool = False

    @property
    def period(self) -> float:
        return self.fft_length * self.pitch

    @property
    def step(self) -> float:
        """The pitch in metres of the samples at the lens, in the panel's coordinates."""
        return self.period / self.folded_length

    @property
    def sample_positions(self) -> torch.Tensor:
        """The positions of the samples at the lens, metres in the panel's coordinates, float64."""
        steps = torch.arange(self.sample_count, dtype=torch.float64)
        return self.first_sample_position + self.step * steps

    @cached_property
    def first_frequency_number(self) -> int:
        """The number of the first frequency in the band, in steps of 1 / period."""
        return math.ceil(self.band.outer_limits[0] * self.period)

    @cached_property
    def frequency_count(self) -> int:
        return math.floor(self.band.outer_limits[1] * self.period) - self.first_frequency_number + 1

    @property
    def spectrum_range(self) -> tuple[int, int]:
        """The numbers of the first and last frequency in the panel's spectrum."""
        return self.shared_range or (
            self.first_frequency_number,
            self.first_frequency_number + self.frequency_count - 1,
        )

    @cached_property
    def spectrum_length(self) -> int:
        """The number of values in the panel's spectrum, at most one period."""
        first, last = self.spectrum_range
        return min(last - first + 1, self.fft_length)

    @cached_property
    def band_frequencies(self) -> torch.Tensor:
        """The panel frequencies that are propagated to the lens, cycles/m, float64."""
        number = (
            torch.arange(self.frequency_count, dtype=torch.float64) + self.first_frequency_number
        )
        return number / self.period

    def transfer(self, dtype: torch.dtype) -> torch.Tensor:
        """Return the transfer function from panel to lens at the band's frequencies."""
        f = self.band_frequencies
        strength = (
            self._envelope(f * self.pixel_side)
            * self.band.taper(f)
            * (self.pixel_side / self.period)
        )
        # The phase in turns may be large, so it is reduced in float64 whatever `dtype` is.
        turns = (
            f * (self.first_sample_position + self.pixel_count // 2 * self.pitch)
            - self.fresnel_area * f**2 / 2
        )
        return (unit_phasor(turns, torch.complex128) * strength).to(dtype)

    def _envelope(self, turns: torch.Tensor) -> torch.Tensor:
        """Return the envelope of a panel pixel at frequencies in cycles per pixel.

        It is a sinc. A wave whose phase rises by g cycles per metre shifts the sinc in frequency:
        sinc(side (f - g)) is about sinc(side f) - side g sinc'(side f). With `has_pixel_slope`, the
        result is the second term for g = 1.
        """
        if not self.has_pixel_slope:
            return torch.sinc(turns)
        near = turns.abs() < 1e-3
        safe = torch.where(near, torch.ones_like(turns), turns)
        slope = (torch.cos(math.pi * safe) - torch.sinc(safe)) / safe
        return -self.pixel_side * torch.where(near, -(math.pi**2) / 3 * turns, slope)

    def spectrum(self, field: torch.Tensor, dim: int) -> torch.Tensor:
        """Return the spectrum of the field behind the panel along the axis `dim`."""
        whole = fft(field, self.fft_length, dim)
        if self.spectrum_length == self.fft_length:
            return whole
        parts = [whole.narrow(dim, start, size) for start, size in self._spectrum_pieces()]
        return parts[0] if len(parts) == 1 else torch.cat(parts, dim)

    def spectrum_adjoint(self, spectrum: torch.Tensor, dim: int) -> torch.Tensor:
        if self.spectrum_length == self.fft_length:
            whole = spectrum
        else:
            shape = list(spectrum.shape)
            shape[dim] = self.fft_length
            whole, at = spectrum.new_zeros(shape), 0
            for start, size in self._spectrum_pieces():
                whole.narrow(dim, start, size).add_(spectrum.narrow(dim, at, size))
                at += size
        return fft(whole, self.fft_length, dim, inverse=True, scaled=False).narrow(
            dim, 0, self.pixel_count
        )

    def to_lens(
        self,
        spectrum: torch.Tensor,
        transfer: torch.Tensor,
        dim: int,
        scratch: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Compute the field at the lens along one axis, from the panel's spectrum.

        scratch: memory for the result, with `folded_length` values along dim. Reusing it saves the
        time of new memory.
        """
        shape = list(spectrum.shape)
        shape[dim] = self.folded_length
        folded = spectrum.new_empty(shape) if scratch is None else scratch
        if self.frequency_count < self.folded_length:
            folded.zero_()
        for source, target, at, size in self._folding_runs():
            weight = _broadcast_along(transfer[at : at + size], dim)
            part, into = spectrum.narrow(dim, source, size), folded.narrow(dim, target, size)
            if at < self.folded_length:
                torch.mul(part, weight, out=into)
            else:
                into.addcmul_(part, weight)
        grid = fft(folded, self.folded_length, dim, inverse=True, scaled=False, overwrite=True)
        return grid.narrow(dim, 0, self.sample_count)

    def to_lens_adjoint(self, grid: torch.Tensor, transfer: torch.Tensor, dim: int) -> torch.Tensor:
        folded = fft(grid, self.folded_length, dim)
        shape = list(grid.shape)
        shape[dim] = self.spectrum_length
        spectrum = grid.new_zeros(shape)
        for source, target, at, size in self._folding_runs():
            weight = _broadcast_along(transfer[at : at + size].conj(), dim)
            spectrum.narrow(dim, source, size).addcmul_(folded.narrow(dim, target, size), weight)
        return spectrum

    def _spectrum_pieces(self) -> Iterator[tuple[int, int]]:
        """Yield start and size of the parts of the panel's spectrum that are kept."""
        first, last = self.spectrum_range
        at = first
        while at <= last:
            start = at % self.fft_length
            size = min(self.fft_length - start, last + 1 - at)
            yield start, size
            at += size

    def slices_in_band(self, low: float, high: float) -> list[slice]:
        """Return the slices of the panel's spectrum with frequencies low to high, cycles/m."""
        first, last = math.ceil(low * self.period), math.floor(high * self.period)
        if self.spectrum_length < self.fft_length:
            start = self.spectrum_range[0]
            return [slice(max(first - start, 0), max(last + 1 - start, 0))]
        if last - first + 1 >= self.fft_length:
            return [slice(0, self.fft_length)]
        first, end = first % self.fft_length, (last + 1) % self.fft_length
        return (
            [slice(first, end)] if first <= end else [slice(0, end), slice(first, self.fft_length)]
        )

    def _folding_runs(self) -> Iterator[tuple[int, int, int, int]]:
        """Divide the band into runs, contiguous in the kept and in the folded spectrum.

        Yields each run's start in the kept spectrum, in the folded spectrum and in the band, and
        its size.
        """
        at, whole = 0, self.spectrum_length == self.fft_length
        while at < self.frequency_count:
            number = self.first_frequency_number + at
            source = number % self.fft_length if whole else number - self.spectrum_range[0]
            target = number % self.folded_length
            # A run ends where the folded spectrum is full for the first time: `to_lens` overwrites
            # up to there, and adds afterwards.
            end = (
                self.frequency_count
                if at >= self.folded_length
                else min(self.frequency_count, self.folded_length)
            )
            size = min(self.spectrum_length - source, self.folded_length - target, end - at)
            yield source, target, at, size
            at += size


def _broadcast_along(values: torch.Tensor, dim: int) -> torch.Tensor:
    return values[:, None] if dim == -2 else values


class PanelToLensPropagator:
    """Propagates a panel's field (..., rows, columns) to the lens grid, (..., y, x), and back.

    It works in two steps. The first step, to the spectrum, depends only on the panel and the bands,
    so that one spectrum serves several distances. The propagation is differentiable in the
    modulation and in the fields of `PropagatorVariables`.
    """

    def __init__(self, y: PropagatorAxis, x: PropagatorAxis, dtype: torch.dtype) -> None:
        self.axes, self.dtype = (y, x), dtype
        self._transfers: tuple[torch.Tensor, torch.Tensor] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        return self.axes[0].sample_count, self.axes[1].sample_count

    def transfers(self, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
        if self._transfers is None or self._transfers[0].device != device:
            y, x = (axis.transfer(self.dtype).to(device) for axis in self.axes)
            self._transfers = (y, x)
        return self._transfers

    def spectrum(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self.axes
        return y.spectrum(x.spectrum(field.to(self.dtype), -1), -2)

    def mean_band_power(
        self, spectrum: torch.Tensor, low: Sequence[float], high: Sequence[float]
    ) -> torch.Tensor:
        """Average the squared modulus of a panel's spectrum over a band of frequencies.

        For a panel that sends the same power to all frequencies, the result is the sum of its
        squared amplitudes.

        spectrum: (..., y, x).
        low, high: limits of the band along y and x, cycles/m.
        """
        y, x = (
            axis.slices_in_band(*ends) for axis, *ends in zip(self.axes, low, high, strict=True)
        )
        found, count = spectrum.real.new_zeros(spectrum.shape[:-2]), 0
        for rows in y:
            for columns in x:
                part = spectrum[..., rows, columns]
                found = found + torch.linalg.vector_norm(part, dim=(-2, -1)) ** 2
                count += part.shape[-2] * part.shape[-1]
        return found / max(count, 1)

    def spectrum_adjoint(self, spectrum: torch.Tensor) -> torch.Tensor:
        y, x = self.axes
        return x.spectrum_adjoint(y.spectrum_adjoint(spectrum, -2), -1)

    def to_lens(
        self,
        spectrum: torch.Tensor,
        extra_y: torch.Tensor | None = None,
        extra_x: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Compute the field at the lens from the panel's spectrum.

        extra_y, extra_x: further factors on the band's frequencies, on top of the transfer
        function.
        """
        y, x = self._weighted_transfers(spectrum.device, extra_y, extra_x)
        return self.axes[1].to_lens(self.axes[0].to_lens(spectrum, y, -2), x, -1)

    def __call__(self, field: torch.Tensor) -> torch.Tensor:
        """Propagate a panel's field to the lens grid, without derivatives."""
        return self.to_lens(self.spectrum(field))

    def adjoint(self, grid: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose: from the lens grid back to the panel."""
        return self.spectrum_adjoint(self.to_lens_adjoint(grid))

    def to_lens_adjoint(
        self,
        grid: torch.Tensor,
        extra_y: torch.Tensor | None = None,
        extra_x: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Apply the conjugate transpose of `to_lens`: from the lens grid to the spectrum."""
        y, x = self._weighted_transfers(grid.device, extra_y, extra_x)
        lines = self.axes[1].to_lens_adjoint(grid.resolve_conj(), x, -1)
        return self.axes[0].to_lens_adjoint(lines, y, -2)

    def _weighted_transfers(
        self, device: torch.device, *extra: torch.Tensor | None
    ) -> Iterator[torch.Tensor]:
        """Yield the transfer functions along y and x, times further factors."""
        for transfer, also in zip(self.transfers(device), extra, strict=True):
            yield transfer if also is None else (transfer * also.to(device)).to(self.dtype)

    def fields_at_lens(
        self, spectrum: torch.Tensor, blocks: Sequence[slice]
    ) -> Iterator[tuple[slice, torch.Tensor]]:
        """Yield the field at the lens block by block, (rows, columns).

        Every block overwrites the memory of the block before.
        """
        y, x = self.transfers(spectrum.device)
        lines = self.axes[0].to_lens(spectrum, y, -2)
        scratch = lines.new_empty(
            (max(_row_count(rows) for rows in blocks), self.axes[1].folded_length)
        )
        for rows in blocks:
            yield rows, self.axes[1].to_lens(lines[rows], x, -1, scratch[: _row_count(rows)])

    @property
    def bytes(self) -> int:
        y, x = self.axes
        spectrum = y.spectrum_length * x.spectrum_length
        between = y.folded_length * x.spectrum_length
        return self.dtype.itemsize * (spectrum + 2 * between + 2 * y.sample_count * x.folded_length)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        y, x = self.axes
        first = y.pixel_count * fft_operations(x.fft_length) + x.spectrum_length * fft_operations(
            y.fft_length
        )
        second = x.spectrum_length * fft_operations(
            y.folded_length
        ) + y.sample_count * fft_operations(x.folded_length)
        touched = (
            y.pixel_count * x.fft_length
            + x.spectrum_length * (y.fft_length + 3 * y.folded_length)
            + 3 * y.sample_count * x.folded_length
        )
        slow = speed.double if self.dtype == torch.complex128 else 1.0
        seconds = (first + second) * speed.fft + touched * speed.touch
        return speed.call + seconds * slow + self.bytes * speed.fresh


@dataclass(frozen=True)
class PropagatorVariables:
    """Holds a propagator's parameters as tensors that carry derivatives.

    Their values are those with which the propagator was planned.

    fresnel_area: square metres, the same for both axes.
    stretch: factor on the positions of the samples at the lens, with the value 1.
    shift: metres (y, x) by which all positions move, with the value 0.
    """

    fresnel_area: torch.Tensor
    stretch: torch.Tensor
    shift: tuple[torch.Tensor, torch.Tensor]


def propagate_to_lens(
    propagator: PanelToLensPropagator,
    field: torch.Tensor,
    variables: PropagatorVariables | None = None,
) -> torch.Tensor:
    """Propagate a field from panel to lens, differentiable in all arguments."""
    if variables is None or not torch.is_grad_enabled():
        return apply_linear_map(propagator, propagator.adjoint, field)
    spectrum = apply_linear_map(
        propagator.spectrum, propagator.spectrum_adjoint, field.to(propagator.dtype)
    )
    numbers = (variables.fresnel_area, variables.stretch, *variables.shift)
    return _shaped_map(propagator)(spectrum, numbers)


def _shaped_map(
    propagator: PanelToLensPropagator,
    extra_y: torch.Tensor | None = None,
    extra_x: torch.Tensor | None = None,
) -> ShapedMap:
    """Return the step to the lens as a map that `PropagatorVariables` shape.

    A spectrum's light of frequency f arrives at y as exp(i pi (2 f (stretch y + shift) - f² area)),
    times further factors on the band's frequencies.
    """

    def weighted(by_y: torch.Tensor | None, by_x: torch.Tensor | None) -> ShapedMap:
        return _shaped_map(propagator, _times(extra_y, by_y), _times(extra_x, by_x))

    def derive(_: ShapedMap) -> Derivatives:
        fy, fx = (axis.band_frequencies for axis in propagator.axes)
        y, x = (axis.sample_positions for axis in propagator.axes)
        turn = 2j * math.pi
        along_y, along_x = weighted(turn * fy, None), weighted(None, turn * fx)
        bends = weighted(-0.5 * turn * fy**2, None), weighted(None, -0.5 * turn * fx**2)
        return [
            [(1.0, one, 1.0) for one in bends],
            [(y[:, None], along_y, 1.0), (x[None, :], along_x, 1.0)],
            [(1.0, along_y, 1.0)],
            [(1.0, along_x, 1.0)],
        ]

    return ShapedMap(
        partial(propagator.to_lens, extra_y=extra_y, extra_x=extra_x),
        partial(propagator.to_lens_adjoint, extra_y=extra_y, extra_x=extra_x),
        derive,
    )


def _times(one: torch.Tensor | None, other: torch.Tensor | None) -> torch.Tensor | None:
    return other if one is None else one if other is None else one * other


def _row_count(rows: slice) -> int:
    return int(rows.stop - rows.start)


def fast_fft_length(least: float) -> int:
    """Return the shortest fast FFT length of at least `least`."""
    return int(scipy.fft.next_fast_len(max(1, math.ceil(least - 1e-9))))
