"""The chirp-Z transform, a Fourier transform between planes of any pitch by a few FFTs."""

from __future__ import annotations

import scipy.fft
import torch

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft, fft_operations
from optics.fourier.geometry import unit_phasor
from optics.fourier.separable import AxisRule, SeparableTransform


class _ChirpRule(AxisRule):
    """A Fourier sum along one axis by Bluestein's convolution with a chirp.

    The phases of the chirp are computed in float64.
    """

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
    """Return the length of the FFTs of a chirp-Z Fourier transform from n samples to m samples."""
    return scipy.fft.next_fast_len(n + m - 1)


class ChirpTransform(SeparableTransform):
    """Computes the Fourier transform by the chirp-Z algorithm, for any pitch and window.

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

    def build_axis_rule(self, axis: int) -> AxisRule:
        """Build the chirp-Z rule of the Fourier transform along axis 0 (y) or 1 (x)."""
        g = self.geometry
        return _ChirpRule(g.pupil.shape[axis], g.image.shape[axis], g.step(axis), self.dtype)

    def _lengths(self) -> list[int]:
        sides = zip(self.geometry.pupil.shape, self.geometry.image.shape, strict=True)
        return [chirp_length(n, m) for n, m in sides]

    @property
    def bytes(self) -> int:
        """The memory in bytes of the chirp Fourier transform's largest arrays."""
        sizes = (a * b for a, b in zip(self._lengths(), self.lines(), strict=True))
        return self.dtype.itemsize * 3 * max(sizes)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of one chirp Fourier transform at a machine's speed."""
        each = zip(self._lengths(), self.lines(), strict=True)
        sizes = [(length, count) for length, count in each]
        operations = sum(2 * count * fft_operations(length) for length, count in sizes)
        touched = 3 * sum(count * length for length, count in sizes)
        seconds = operations * speed.fft + touched * speed.touch
        return (
            speed.call + seconds * self.precision_slowdown(speed) + self.allocation_seconds(speed)
        )
