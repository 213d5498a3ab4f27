"""Take a panel's spectrum through lens and stop to the sensor, a few rows of the lens at a time."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator

import torch

from optics.accuracy import Budget, MachineSpeed, cheapest_candidate
from optics.chebyshev import expand_in_chebyshev
from optics.fourier import FourierGeometry, unit_phasor, valid_transforms
from optics.fourier.differentiation import apply_linear_map
from optics.fourier.separable import SeparableTransform
from optics.plane import Plane
from optics.psf.stop_mask import BlockwiseStopMask
from optics.psf.to_lens import PanelToLensPropagator

_ROWS = 64  # rows of samples whose wave is computed at a time

_WAVE_PASSES = 50.0  # time to compute the wave of a sample, in passes; fitted to 28 random chains


class LensWave:
    """Holds a lens' wave exp(i phase) on a plane, cached or computed anew for every call.

    phase: a function of y and x in metres that returns radians, float64.
    dtype: complex.
    memory_limit: bytes up to which the wave is cached. A phase that no Chebyshev expansion
    represents is always cached.
    """

    def __init__(
        self,
        phase: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
        plane: Plane,
        dtype: torch.dtype,
        memory_limit: float,
    ) -> None:
        self._phase, self._plane, self._dtype = phase, plane, dtype
        self._expansion = expand_in_chebyshev(phase, plane)
        rows, columns = plane.shape
        self._size = rows * columns * dtype.itemsize
        self.is_cached = self._expansion is None or self._size <= memory_limit
        self._cached_wave: torch.Tensor | None = None

    @property
    def bytes(self) -> int:
        making = 6 * 8 * self._plane.shape[1] * _ROWS
        if self._expansion is None:
            return 6 * self._size
        return making + (self._size if self.is_cached else 0)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds per call, 0 if the wave is cached."""
        return 0.0 if self.is_cached else self._wave_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of `prepare`."""
        return self._wave_seconds(speed) if self.is_cached else 0.0

    def _wave_seconds(self, speed: MachineSpeed) -> float:
        rows, columns = self._plane.shape
        return _WAVE_PASSES * rows * columns * speed.touch

    def prepare(self) -> None:
        """Compute the wave now if it is to be cached."""
        if not self.is_cached or self._cached_wave is not None:
            return
        if self._expansion is None:
            self._cached_wave = self._wave(self._phase(*self._plane.mesh()))
            return
        count = self._plane.shape[0]
        self._cached_wave = torch.empty(self._plane.shape, dtype=self._dtype)
        for first in range(0, count, _ROWS):
            part = slice(first, min(first + _ROWS, count))
            self._cached_wave[part] = self._wave(self._expansion.rows(part))

    def wave_on_rows(self, part: slice) -> torch.Tensor:
        """Return the wave on some rows, (rows, columns); call prepare() before."""
        if self._cached_wave is not None:
            return self._cached_wave[part]
        assert self._expansion is not None
        return self._wave(self._expansion.rows(part))

    def _wave(self, phase: torch.Tensor) -> torch.Tensor:
        return unit_phasor(phase / (2 * math.pi), self._dtype)


PictureMap = Callable[[torch.Tensor], torch.Tensor]


class PanelToSensorMap:
    """Maps a panel's spectrum linearly to the field at the sensor, and back by the adjoint.

    The field at the lens is never in memory as a whole. The propagation to the lens, the lens, and
    the Fourier integral to the sensor all work along one axis after the other; only the stop's edge
    and aberrations don't. So each block of rows is taken all the way along x before the next block.
    Call `set_lens_wave` before the map is used.

    geometry: of the Fourier integral from the lens to the sensor.
    error: relative L2 error that its transform may have.
    """

    def __init__(
        self,
        propagator: PanelToLensPropagator,
        stop_mask: BlockwiseStopMask,
        geometry: FourierGeometry,
        error: float,
        budget: Budget,
    ) -> None:
        self.propagator, self._stop_mask = propagator, stop_mask
        offered = valid_transforms(geometry, propagator.dtype, error)
        separable = [one for one in offered if isinstance(one, SeparableTransform)]
        self.sensor_transform = cheapest_candidate(
            separable, budget, "light from the lens to the sensor"
        )
        self._lens_factors: tuple[torch.Tensor, torch.Tensor] | None = None
        self._wave: LensWave | None = None

    def set_lens_wave(
        self, factors: tuple[torch.Tensor, torch.Tensor], wave: LensWave | None = None
    ) -> None:
        """Set the wave of the lens.

        factors: along y and x.
        wave: the remaining factor, which depends on both, or None.
        """
        geometry, dtype = self.sensor_transform.geometry, self.propagator.dtype
        tilts = [geometry.pupil_tilt(axis, torch.complex128) for axis in (0, 1)]
        y, x = (
            (factor if tilt is None else factor * tilt).to(dtype)[:, None]
            for factor, tilt in zip(factors, tilts, strict=True)
        )
        self._lens_factors, self._wave = (y, x), wave
        self._image_tilts = tuple(geometry.image_tilt(axis, dtype) for axis in (0, 1))

    def with_propagator(self, propagator: PanelToLensPropagator) -> PanelToSensorMap:
        """Return a copy with another propagator to the same lens samples."""
        other = copy.copy(self)
        other.propagator = propagator
        return other

    def _lens_factors_on(self, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
        assert self._lens_factors is not None
        y, x = self._lens_factors
        return y.to(device), x.to(device)

    def __call__(self, spectrum: torch.Tensor) -> torch.Tensor:
        """Compute the field at the sensor, (rows, columns), from one spectrum of the panel."""
        y_rule, x_rule = self.sensor_transform.axis_rules(spectrum.device)
        turn_y, _ = self._lens_factors_on(spectrum.device)
        found = spectrum.new_empty((self.sensor_transform.image.shape[1], self.propagator.shape[0]))
        for rows, field in self._fields_behind_stop(spectrum):
            found[:, rows] = x_rule.forward(field.mT.contiguous())
        if self._image_tilts[1] is not None:
            found *= self._image_tilts[1].to(found.device)[:, None]
        field = y_rule.forward(found.mT * turn_y)
        return (
            field
            if self._image_tilts[0] is None
            else field * self._image_tilts[0].to(field.device)[:, None]
        )

    def _fields_behind_stop(self, spectrum: torch.Tensor) -> Iterator[tuple[slice, torch.Tensor]]:
        """Yield the field behind the stop by blocks, without the lens' factor along y."""
        turn_x = self._lens_factors_on(spectrum.device)[1][:, 0]
        arriving = self.propagator.fields_at_lens(spectrum, self._stop_mask.row_blocks)
        for block, (rows, field) in enumerate(arriving):
            field *= turn_x
            if self._wave is not None:
                field *= self._wave.wave_on_rows(rows).to(field.device)
            self._stop_mask.apply(field, block)
            yield rows, field

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose: from the field at the sensor to the panel's spectrum."""
        field = field.to(self.propagator.dtype)
        y_rule, x_rule = self.sensor_transform.axis_rules(field.device)
        turn_y, turn_x = (
            line.conj().resolve_conj() for line in self._lens_factors_on(field.device)
        )
        y_axis, x_axis = self.propagator.axes
        y_transfer, x_transfer = self.propagator.transfers(field.device)
        if self._image_tilts[0] is not None:
            field = field * self._image_tilts[0].to(field.device).conj()[:, None]
        back = (y_rule.adjoint(field) * turn_y).mT
        if self._image_tilts[1] is not None:
            back = back * self._image_tilts[1].to(field.device).conj()[:, None]
        lines = field.new_empty((y_axis.sample_count, x_axis.spectrum_length))
        for block, rows in enumerate(self._stop_mask.row_blocks):
            part = x_rule.adjoint(back[:, rows].contiguous()).mT * turn_x[:, 0]
            if self._wave is not None:
                part *= self._wave.wave_on_rows(rows).to(field.device).conj()
            self._stop_mask.apply(part, block)
            lines[rows] = x_axis.to_lens_adjoint(part, x_transfer, -1)
        return y_axis.to_lens_adjoint(lines, y_transfer, -2)

    @property
    def bytes(self) -> int:
        y, x = self.propagator.axes
        rows, columns = self.sensor_transform.image.shape
        between = x.spectrum_length * y.sample_count + columns * y.sample_count + rows * columns
        spectrum = x.spectrum_length * (y.spectrum_length + y.fft_length + y.folded_length)
        block = 6 * 16 * max(x.folded_length, x.sample_count)
        return self.propagator.dtype.itemsize * (2 * between + spectrum + block)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        # Each block of rows takes about as long as a call, whatever its size.
        blocks = len(self._stop_mask.row_blocks) * speed.call
        return (
            blocks + self.propagator.cpu_seconds(speed) + self.sensor_transform.cpu_seconds(speed)
        )


def panel_spectrum(propagator: PanelToLensPropagator, field: torch.Tensor) -> torch.Tensor:
    """Compute the spectrum of a panel's field, (..., y, x), complex; differentiable in the field.

    propagator: determines which frequencies are computed.
    field: complex, (..., rows, columns).
    """
    return apply_linear_map(propagator.spectrum, propagator.spectrum_adjoint, field)


def propagate_to_sensor(sensor_map: PanelToSensorMap, spectrum: torch.Tensor) -> torch.Tensor:
    """Compute the field at the sensor, (..., rows, columns), differentiable in the spectrum."""
    return apply_linear_map(
        _apply_per_picture(sensor_map), _apply_per_picture(sensor_map.adjoint), spectrum
    )


def _apply_per_picture(function: PictureMap) -> PictureMap:
    """Return a function that applies a map to the pictures of a batch one by one.

    A batch takes no more memory than one picture and the results.
    """

    def each(fields: torch.Tensor) -> torch.Tensor:
        if fields.ndim == 2:
            return function(fields)
        done = torch.stack([function(one) for one in fields.reshape(-1, *fields.shape[-2:])])
        return done.reshape(*fields.shape[:-2], *done.shape[-2:])

    return each
