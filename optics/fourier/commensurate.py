"""Fourier transforms by pruned or folded FFTs, for planes whose pitches are commensurate."""

from __future__ import annotations

import torch

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft, fft_operations
from optics.fourier.geometry import FourierGeometry, unit_phasor
from optics.fourier.separable import AxisRule, SeparableTransform
from optics.fourier.transform import RETAINED_BYTES


def commensurate_length(geometry: FourierGeometry, axis: int) -> int:
    """Return the FFT length that fits a Fourier geometry along an axis, or 0 if none fits.

    The length is one over the geometry's step, if that is a whole number.
    """
    exact = 1 / geometry.step(axis)
    length = max(round(exact), 1)
    farthest = geometry.pupil.shape[axis] / 2 * geometry.image.shape[axis] / 2
    # Rounding the length changes the phase between the outermost samples, by 1e-12 turns at most.
    error = abs(1 / length - geometry.step(axis)) * farthest
    return length if error < 1e-12 else 0


class _CommensurateRule(AxisRule):
    """A Fourier sum along one axis by an FFT of `length`.

    The input is folded into that length or padded to it, and the requested outputs are selected
    from its period.
    """

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
        """Add up the Fourier sum's input samples that lie a whole number of FFT periods apart."""
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
    """Computes the Fourier transform by one FFT per axis, where one over the step is whole.

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

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype) -> None:
        super().__init__(geometry, dtype)
        self._lengths = [commensurate_length(geometry, axis) for axis in (0, 1)]
        if 0 in self._lengths:
            raise ValueError(
                "one over the step of this geometry isn't a whole number; use the chirp-Z transform"
            )

    @staticmethod
    def is_commensurate(geometry: FourierGeometry) -> bool:
        """Tell whether one over a Fourier geometry's step is whole along both axes."""
        return all(commensurate_length(geometry, axis) for axis in (0, 1))

    def build_axis_rule(self, axis: int) -> AxisRule:
        """Build the FFT rule of the Fourier transform along axis 0 (y) or 1 (x)."""
        n, m = self.geometry.pupil.shape[axis], self.geometry.image.shape[axis]
        return _CommensurateRule(n, m, self._lengths[axis], self.dtype)

    @property
    def bytes(self) -> int:
        """The memory in bytes of the commensurate Fourier transform's largest arrays."""
        sizes = (a * b for a, b in zip(self._lengths, self.lines(), strict=True))
        return self.dtype.itemsize * 2 * max(sizes)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of a commensurate Fourier transform at a machine speed."""
        each = zip(self._lengths, self.lines(), strict=True)
        operations = sum(count * fft_operations(length) for length, count in each)
        (ny, nx), (_, mx) = self.geometry.pupil.shape, self.geometry.image.shape
        made = self._samples_made()
        touched = 2 * ny * (nx + mx) + sum(made)
        seconds = operations * speed.fft + touched * speed.touch
        new = sum(max(self.dtype.itemsize * count - RETAINED_BYTES, 0) for count in made)
        return speed.call + seconds * self.precision_slowdown(speed) + new * speed.fresh

    def _samples_made(self) -> list[int]:
        """Count the samples of each array that the commensurate Fourier transform makes."""
        g, found = self.geometry, []
        for axis, (count, length) in enumerate(zip(self.lines(), self._lengths, strict=True)):
            n, m = g.pupil.shape[axis], g.image.shape[axis]
            found += [count * length, count * m]
            found += [count * n] if g.image.centre[axis] else []
            found += [count * m] if g.pupil.centre[axis] else []
        return found
