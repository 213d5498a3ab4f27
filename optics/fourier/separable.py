"""Transforms along one axis after the other: by chirps, or by pruned and folded FFTs.

Chirps take planes of any pitch; pruned and folded FFTs those whose pitches are commensurate.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

import scipy.fft
import torch

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft, fft_operations
from optics.fourier.transform import RETAINED_BYTES, FourierGeometry, PlaneTransform, unit_phasor


class AxisRule(ABC):
    """Base class of sums along one axis, from n centred samples to m centred samples:

        C[k] = sum over j of f[j] exp(-2 pi i step (j - n // 2) (k - m // 2)).

    The sum and its adjoint work along the second last axis, (..., n or m, lines).
    """

    @abstractmethod
    def forward(self, field: torch.Tensor) -> torch.Tensor:
        """Compute the sum, from (..., n, lines) to (..., m, lines)."""

    @abstractmethod
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose, from (..., m, lines) to (..., n, lines)."""

    @abstractmethod
    def to(self, device: torch.device) -> None:
        """Move the precomputed arrays to a device."""


class SeparableTransform(PlaneTransform):
    """Base class of transforms that apply one rule along y, then one along x.

    Planes that are off centre are handled by a phase factor before or after each rule.
    """

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype) -> None:
        super().__init__(geometry, dtype)
        # How many lines of samples are transformed along y and along x.
        self._lines = geometry.pupil.shape[1], geometry.image.shape[0]
        self._rules: tuple[AxisRule, AxisRule] | None = None

    @cached_property
    def _pupil_phases(self) -> tuple[torch.Tensor | None, ...]:
        """Phases over the pupil along y and x for an off-centre image, made at the first call."""
        return tuple(self.geometry.pupil_tilt(axis, self.dtype) for axis in (0, 1))

    @cached_property
    def _image_phases(self) -> tuple[torch.Tensor | None, ...]:
        """Phases over the image along y and x for an off-centre pupil."""
        return tuple(self.geometry.image_tilt(axis, self.dtype) for axis in (0, 1))

    @abstractmethod
    def build_axis_rule(self, axis: int) -> AxisRule:
        """Build the rule along axis 0 (y) or 1 (x)."""

    def axis_rules(self, device: torch.device) -> tuple[AxisRule, AxisRule]:
        """Return the rules along y and x on a device; they are built at the first call."""
        if self._rules is None:
            self._rules = (self.build_axis_rule(0), self.build_axis_rule(1))
        for rule in self._rules:
            rule.to(device)
        return self._rules

    def _forward_axis(self, field: torch.Tensor, axis: int, rule: AxisRule) -> torch.Tensor:
        """Transform a field along its second last dimension, which belongs to `axis`."""
        before, after = self._pupil_phases[axis], self._image_phases[axis]
        if before is not None:
            field = field * before.to(field.device)[:, None]
        field = rule.forward(field)
        return field if after is None else field * after.to(field.device)[:, None]

    def _adjoint_axis(self, field: torch.Tensor, axis: int, rule: AxisRule) -> torch.Tensor:
        before, after = self._pupil_phases[axis], self._image_phases[axis]
        if after is not None:
            field = field * after.conj().to(field.device)[:, None]
        field = rule.adjoint(field)
        return field if before is None else field * before.conj().to(field.device)[:, None]

    def forward_axis(self, field: torch.Tensor, axis: int) -> torch.Tensor:
        """Apply the rule of one axis, 0 (y) or 1 (x), to a field."""
        rule, field = self.axis_rules(field.device)[axis], field.to(self.dtype)
        if axis == 0:
            return self._forward_axis(field, 0, rule)
        return self._forward_axis(field.mT.contiguous(), 1, rule).mT

    def _forward(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self.axis_rules(field.device)
        return self._forward_axis(self._forward_axis(field, 0, y).mT.contiguous(), 1, x).mT

    def _adjoint(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self.axis_rules(field.device)
        return self._adjoint_axis(
            self._adjoint_axis(field.mT.contiguous(), 1, x).mT.contiguous(), 0, y
        )


class _ChirpRule(AxisRule):
    """Convolves with a chirp (Bluestein), whose phases are computed in float64."""

    def __init__(self, n: int, m: int, step: float, dtype: torch.dtype) -> None:
        self.n, self.m = n, m
        self.length = chirp_length(n, m)
        j = torch.arange(n, dtype=torch.float64) - n // 2
        k = torch.arange(m, dtype=torch.float64) - m // 2
        self.before = unit_phasor(-step * j**2 / 2, dtype)[:, None]
        self.after = unit_phasor(-step * k**2 / 2, dtype)[:, None]
        lag = torch.arange(-(n - 1), m, dtype=torch.float64)
        chirp = unit_phasor(step * (lag + n // 2 - m // 2) ** 2 / 2, torch.complex128)
        kernel = torch.zeros(self.length, dtype=torch.complex128)
        kernel[lag.long() % self.length] = chirp
        self.kernel = torch.fft.fft(kernel).to(dtype)[:, None]

    def to(self, device: torch.device) -> None:
        if self.kernel.device != device:
            self.before, self.after = self.before.to(device), self.after.to(device)
            self.kernel = self.kernel.to(device)

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        spectrum = fft(field * self.before, self.length, -2) * self.kernel
        return fft(spectrum, self.length, -2, inverse=True)[..., : self.m, :] * self.after

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        spectrum = fft(field * self.after.conj(), self.length, -2) * self.kernel.conj()
        signal = fft(spectrum, self.length, -2, inverse=True)
        return signal[..., : self.n, :] * self.before.conj()


def chirp_length(n: int, m: int) -> int:
    """Return the length of the FFTs that take n samples to m."""
    return scipy.fft.next_fast_len(n + m - 1)


class ChirpTransform(SeparableTransform):
    """Convolves with chirps (chirp-Z algorithm), for any pitch and window.

    It costs a few FFTs and is exact to rounding.

    Parameters
    ----------
    geometry : FourierGeometry
        The two planes; the pupil is a Plane.
    dtype : torch.dtype
        complex64 or complex128.

    References
    ----------
    L. R. Rabiner, R. W. Schafer and C. M. Rader, 1969.
    """

    name = "chirp-Z"
    bytes = 0

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype) -> None:
        super().__init__(geometry, dtype)
        (ny, nx), (my, mx) = geometry.pupil.shape, geometry.image.shape
        self._lengths = chirp_length(ny, my), chirp_length(nx, mx)
        (down, along), (columns, rows) = self._lengths, self._lines
        self.bytes = dtype.itemsize * 3 * max(down * columns, along * rows)

    def build_axis_rule(self, axis: int) -> AxisRule:
        """Build the convolution along axis 0 (y) or 1 (x)."""
        g = self.geometry
        return _ChirpRule(g.pupil.shape[axis], g.image.shape[axis], g.step(axis), self.dtype)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of one call at a machine's speed."""
        (down, along), (columns, rows) = self._lengths, self._lines
        operations = 2 * columns * fft_operations(down) + 2 * rows * fft_operations(along)
        touched = 3 * (columns * down + rows * along)
        seconds = operations * speed.fft + touched * speed.touch
        return speed.call + seconds * speed.slowdown(self.dtype) + self.allocation_seconds(speed)


def commensurate_length(geometry: FourierGeometry, axis: int) -> int:
    """Return the FFT's length along an axis, one over the step; 0 if that isn't a whole number."""
    exact = 1 / geometry.step(axis)
    length = max(round(exact), 1)
    farthest = geometry.pupil.shape[axis] / 2 * geometry.image.shape[axis] / 2
    # Rounding the length changes the phase between the outermost samples, by 1e-12 turns at most.
    error = abs(1 / length - geometry.step(axis)) * farthest
    return length if error < 1e-12 else 0


class _CommensurateRule(AxisRule):
    """Folds the input into one FFT's `length` or pads it, and selects outputs from its period."""

    def __init__(self, n: int, m: int, length: int, dtype: torch.dtype) -> None:
        self.n, self.m, self.length = n, m, length
        k = torch.arange(m, dtype=torch.float64) - m // 2
        # The FFT takes the first sample to be at 0 instead of -(n // 2); this phase corrects it.
        self.phase = unit_phasor(k * (n // 2) / length, dtype)[:, None]
        self.index = (torch.arange(m) - m // 2) % length

    def to(self, device: torch.device) -> None:
        self.phase, self.index = self.phase.to(device), self.index.to(device)

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        spectrum = fft(self._fold_periods(field), self.length, -2)
        return spectrum.index_select(-2, self.index).mul_(self.phase)

    def _fold_periods(self, field: torch.Tensor) -> torch.Tensor:
        """Add up the input samples that lie a whole number of FFT periods apart."""
        if self.n <= self.length:
            return field
        whole = self.n // self.length * self.length
        shape = (*field.shape[:-2], self.n // self.length, self.length, field.shape[-1])
        # A sum of complex numbers takes twice as long, and padding the rest copies all of it.
        parts = torch.view_as_real(field[..., :whole, :].reshape(shape))
        total = torch.view_as_complex(parts.sum(-4))
        total[..., : self.n - whole, :] += field[..., whole:, :]
        return total

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        shape = (*field.shape[:-2], self.length, field.shape[-1])
        spectrum = field.new_zeros(shape).index_add(-2, self.index, field * self.phase.conj())
        signal = fft(spectrum, self.length, -2, inverse=True, scaled=False)
        periods = -(-self.n // self.length)
        return signal.tile((periods, 1))[..., : self.n, :]


class CommensurateTransform(SeparableTransform):
    """Takes one pruned or folded FFT per axis, where one over the step is whole.

    It is exact to rounding. An image with a small pitch needs long FFTs, of which only the
    requested outputs are kept (a pruned FFT). An image with a pitch that undersamples the finest
    fringe of the pupil needs FFTs that are shorter than the pupil; the input is then folded, since
    undersampling in one plane is aliasing in the other.

    Parameters
    ----------
    geometry : FourierGeometry
        The two planes. One over `FourierGeometry.step` must be a whole number along both axes.
    dtype : torch.dtype
        complex64 or complex128.

    Raises
    ------
    ValueError
        If one over the step isn't a whole number.
    """

    name = "folded or pruned FFT"
    bytes = 0

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype) -> None:
        super().__init__(geometry, dtype)
        self._lengths = commensurate_length(geometry, 0), commensurate_length(geometry, 1)
        if 0 in self._lengths:
            raise ValueError(
                "one over the step of this geometry isn't a whole number; use the chirp-Z transform"
            )
        (down, along), (columns, rows) = self._lengths, self._lines
        self.bytes = dtype.itemsize * 2 * max(down * columns, along * rows)

    @staticmethod
    def is_commensurate(geometry: FourierGeometry) -> bool:
        """Tell whether one over the step is whole along both axes."""
        return bool(commensurate_length(geometry, 0) and commensurate_length(geometry, 1))

    def build_axis_rule(self, axis: int) -> AxisRule:
        """Build the rule of one FFT along axis 0 (y) or 1 (x)."""
        n, m = self.geometry.pupil.shape[axis], self.geometry.image.shape[axis]
        return _CommensurateRule(n, m, self._lengths[axis], self.dtype)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of one call at a machine's speed."""
        g, operations, new = self.geometry, 0.0, 0
        (ny, nx), (_, mx) = g.pupil.shape, g.image.shape
        touched = 2 * ny * (nx + mx)
        for axis, (count, length) in enumerate(zip(self._lines, self._lengths, strict=True)):
            operations += count * fft_operations(length)
            n, m = g.pupil.shape[axis], g.image.shape[axis]
            # The samples of each line in each array that a call makes.
            made = [length, m]
            made += [n] if g.image.centre[axis] else []
            made += [m] if g.pupil.centre[axis] else []
            touched += count * sum(made)
            for samples in made:
                new += max(self.dtype.itemsize * count * samples - RETAINED_BYTES, 0)
        seconds = operations * speed.fft + touched * speed.touch
        return speed.call + seconds * speed.slowdown(self.dtype) + new * speed.fresh
