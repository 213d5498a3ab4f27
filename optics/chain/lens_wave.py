"""Compute a lens' transmitted wave at samples in its plane, a few rows at a time."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

from optics.accuracy import MachineSpeed
from optics.chebyshev import expand_in_chebyshev
from optics.fourier import unit_phasor
from optics.plane import Plane

_ROWS = 64
"""Rows of samples whose wave is computed at a time."""

_WAVE_PASSES = 50.0
"""Time to compute the wave of a sample, in passes; fitted to 28 random chains."""


class LensWave:
    """Holds a lens' wave exp(i phase) on a plane, cached or computed anew for every call.

    phase: a function of y and x in metres that returns radians, float64. dtype: complex.
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
        """Predict the processor seconds per call for the chain's lens wave, 0 if it is cached."""
        return 0.0 if self.is_cached else self._wave_seconds(speed)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of `prepare` for the chain's lens wave."""
        return self._wave_seconds(speed) if self.is_cached else 0.0

    def _wave_seconds(self, speed: MachineSpeed) -> float:
        rows, columns = self._plane.shape
        return _WAVE_PASSES * rows * columns * speed.touch

    def prepare(self) -> None:
        """Compute the wave of the chain's lens now if it is to be cached."""
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
        """Return the chain's lens wave on some rows, (rows, columns); call prepare() before."""
        if self._cached_wave is not None:
            return self._cached_wave[part]
        assert self._expansion is not None
        return self._wave(self._expansion.rows(part))

    def _wave(self, phase: torch.Tensor) -> torch.Tensor:
        return unit_phasor(phase / (2 * math.pi), self._dtype)
