"""Compute the spectrum of samples along one axis on part of an FFT's grid."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import scipy.fft
import torch

from optics.fourier.fft import fft, fft_operations


class SpectrumGrid(ABC):
    """Base class of the spectra of a field along one axis, on some points of an FFT's grid.

    count: number of samples of the whole field along the axis.
    length: of the FFT, `count` at least.
    grid: points v that are wanted, at frequencies v / length in cycles per sample.
    """

    def __init__(self, count: int, length: int, grid: range) -> None:
        self.count, self.length, self.grid = count, length, grid

    @abstractmethod
    def forward(self, field: torch.Tensor, dim: int) -> torch.Tensor:
        """Compute the field's spectrum along an axis, on the grid points that are kept."""

    @abstractmethod
    def adjoint(self, spectrum: torch.Tensor, dim: int) -> torch.Tensor:
        """Apply the conjugate transpose of `forward`."""

    def unfold(self, lines: torch.Tensor) -> torch.Tensor:
        """Repeat the kept points along the first axis where `grid` is longer."""
        return lines

    def fold(self, lines: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose of `unfold`."""
        return lines

    @property
    @abstractmethod
    def kept_count(self) -> int:
        """Number of grid points that are kept."""

    @property
    @abstractmethod
    def operations(self) -> float:
        """Floating-point operations for one line of samples."""


class FullSpectrum(SpectrumGrid):
    """Computes a whole FFT; phases count from the first sample."""

    @property
    def kept_count(self) -> int:
        return min(len(self.grid), self.length)

    @property
    def operations(self) -> float:
        return fft_operations(self.length)

    def _index(self, device: torch.device) -> torch.Tensor:
        first = self.grid.start
        return torch.arange(first, first + self.kept_count, device=device) % self.length

    def forward(self, field: torch.Tensor, dim: int) -> torch.Tensor:
        return fft(field, self.length, dim).index_select(dim, self._index(field.device))

    def adjoint(self, spectrum: torch.Tensor, dim: int) -> torch.Tensor:
        shape = list(spectrum.shape)
        shape[dim] = self.length
        whole = spectrum.new_zeros(shape).index_copy_(dim, self._index(spectrum.device), spectrum)
        field = fft(whole, self.length, dim, inverse=True, scaled=False, overwrite=True)
        return field.narrow(dim, 0, self.count)

    def unfold(self, lines: torch.Tensor) -> torch.Tensor:
        if len(self.grid) == self.kept_count:
            return lines
        index = torch.arange(len(self.grid), device=lines.device) % self.kept_count
        return lines.index_select(0, index)

    def fold(self, lines: torch.Tensor) -> torch.Tensor:
        if len(self.grid) == self.kept_count:
            return lines
        index = torch.arange(len(self.grid), device=lines.device) % self.kept_count
        return lines.new_zeros(self.kept_count, lines.shape[1]).index_add_(0, index, lines)


class MirroredSpectrum(SpectrumGrid):
    """Computes a cosine transform of a field that is mirrored in its middle.

    The field's second half is given, with the middle sample of an odd number. Phases count from the
    middle. The spectrum is even, so that the points from zero on are kept; those of `grid` must lie
    within half of the FFT's length.
    """

    @property
    def kept_count(self) -> int:
        return max(-self.grid.start, self.grid.stop - 1, 0) + 1

    @property
    def operations(self) -> float:
        return fft_operations(self.length) / 2

    def forward(self, field: torch.Tensor, dim: int) -> torch.Tensor:
        half = self.length // 2
        if field.device.type != "cpu":
            return self._forward_on_device(field, dim)
        odd = self.count % 2
        lines: Any = field.numpy()
        found = scipy.fft.dct(lines, type=1 if odd else 2, n=half + odd, axis=dim)
        return torch.from_numpy(found).narrow(dim, 0, self.kept_count).contiguous()

    def adjoint(self, spectrum: torch.Tensor, dim: int) -> torch.Tensor:
        half, given = self.length // 2, (self.count + 1) // 2
        if spectrum.device.type != "cpu":
            return self._adjoint_on_device(spectrum, dim)
        odd = self.count % 2
        # The cosine transforms count the point at frequency zero once, and all others twice.
        whole = spectrum.clone()
        whole.narrow(dim, 0, 1).mul_(2)
        lines: Any = whole.numpy()
        found = torch.from_numpy(scipy.fft.dct(lines, type=1 if odd else 3, n=half + odd, axis=dim))
        field = found.narrow(dim, 0, given).contiguous()
        if odd:
            field.narrow(dim, 0, 1).mul_(0.5)
        return field

    def _forward_on_device(self, field: torch.Tensor, dim: int) -> torch.Tensor:
        """Compute a whole FFT instead, where scipy can't."""
        spectrum = torch.fft.fft(self._mirror(field, dim), n=self.length, dim=dim)
        return self._turn(spectrum.narrow(dim, 0, self.kept_count), dim)

    def _adjoint_on_device(self, spectrum: torch.Tensor, dim: int) -> torch.Tensor:
        turned = self._turn(spectrum, dim, conjugate=True)
        whole = torch.fft.ifft(turned, n=self.length, dim=dim, norm="forward")
        second = whole.narrow(dim, self.count // 2, (self.count + 1) // 2)
        first = whole.narrow(dim, 0, self.count // 2).flip(dim)
        field = second.clone()
        field.narrow(dim, self.count % 2, self.count // 2).add_(first)
        return field

    def _mirror(self, field: torch.Tensor, dim: int) -> torch.Tensor:
        other = field.narrow(dim, self.count % 2, self.count // 2).flip(dim)
        return torch.cat([other, field], dim)

    def _turn(self, spectrum: torch.Tensor, dim: int, *, conjugate: bool = False) -> torch.Tensor:
        """Turn phases from counting at the first sample to counting at the middle, or back."""
        points = torch.arange(self.kept_count, dtype=torch.float64, device=spectrum.device)
        angle = torch.pi * (self.count - 1) / self.length * points
        phases = torch.polar(torch.ones_like(angle), -angle if conjugate else angle)
        shape = [1] * spectrum.ndim
        shape[dim] = self.kept_count
        return spectrum * phases.to(spectrum.dtype).reshape(shape)
