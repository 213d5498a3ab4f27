"""Compute the wave on the sensor from the wave on the panel, for quarter and for whole patterns.

The wave on the sensor is the Fourier sum of the panel's pixels (thesis Eq. 3.1), in samples that
are `step` turns per pixel apart. For a pattern that is mirrored about the middle of the panel it is
real-linear in a quarter of the pixels, with cosines for kernels. The maps and their adjoints leave
out phase factors over the sensor, which the light doesn't show.
"""

from __future__ import annotations

import math
from typing import Protocol

import scipy.fft
import torch

from optics.fourier import ChirpTransform, FourierGeometry, fft
from optics.plane import Plane


class FieldMap(Protocol):
    """A linear map from the wave on a panel to the wave on a sensor's samples."""

    def __call__(self, wave: torch.Tensor, /) -> torch.Tensor:
        """Compute the wave on the sensor, complex (rows, columns), from that on the panel."""

    def adjoint(self, wave: torch.Tensor, /) -> torch.Tensor:
        """Apply the conjugate transpose to a wave on the sensor, complex (rows, columns)."""


class CosineMatrixMap(FieldMap):
    """Maps a quarter of a symmetric panel's wave by two matrices, for any step.

    The product with the matrix of the longer axis comes first, as it shrinks the wave most.

    shape: (rows, columns) of the quarter.
    reach: samples from the middle of the sensor to the window's border.
    step: turns per panel pixel and sample.
    dtype: complex64 or complex128.
    """

    def __init__(self, shape: tuple[int, int], reach: int, step: float, dtype: torch.dtype) -> None:
        samples = torch.arange(reach + 1, dtype=torch.float64)
        self._matrices = []
        for count in shape:
            middle = torch.arange(count, dtype=torch.float64) + 0.5
            turns = torch.outer(middle, samples) * step
            kernel = 2 * torch.cos(2 * math.pi * (turns - torch.round(turns)))
            self._matrices.append(kernel.to(dtype.to_real()))

    def __call__(self, wave: torch.Tensor) -> torch.Tensor:
        along_y, along_x = self._on_device(wave)
        return torch.complex(*(along_y.T @ (part @ along_x) for part in (wave.real, wave.imag)))

    def adjoint(self, wave: torch.Tensor) -> torch.Tensor:
        along_y, along_x = self._on_device(wave)
        return torch.complex(*((along_y @ part) @ along_x.T for part in (wave.real, wave.imag)))

    def _on_device(self, wave: torch.Tensor) -> list[torch.Tensor]:
        """Return the cosine matrices on the device of a wave, where they stay."""
        self._matrices = [one.to(wave.device) for one in self._matrices]
        return self._matrices


class CosineTransformMap(FieldMap):
    """Maps a quarter of a symmetric panel's wave by fast cosine transforms.

    On other devices than the CPU, matrices compute the same sums.

    shape: (rows, columns) of the quarter; each at most twice `length`.
    reach: samples from the middle of the sensor to the window's border.
    length: of the cosine transforms, half a period; the step is 1 / (2 length) turns.
    """

    def __init__(self, shape: tuple[int, int], reach: int, length: int) -> None:
        self._shape, self._reach, self._length = shape, reach, length
        self._matrices: CosineMatrixMap | None = None

    def __call__(self, wave: torch.Tensor) -> torch.Tensor:
        if wave.device.type != "cpu":
            return self._matrix_map(wave.dtype)(wave)
        parts = torch.stack((wave.real, wave.imag))
        for axis in (-1, -2):
            parts = self._transform(parts, axis)
        return torch.complex(parts[0], parts[1])

    def adjoint(self, wave: torch.Tensor) -> torch.Tensor:
        if wave.device.type != "cpu":
            return self._matrix_map(wave.dtype).adjoint(wave)
        parts = torch.stack((wave.real, wave.imag))
        for axis in (-2, -1):
            parts = self._transpose(parts, axis)
        return torch.complex(parts[0], parts[1])

    def _matrix_map(self, dtype: torch.dtype) -> CosineMatrixMap:
        """Return the same map by matrices, for devices without scipy."""
        if self._matrices is None:
            step = 1 / (2 * self._length)
            self._matrices = CosineMatrixMap(self._shape, self._reach, step, dtype)
        return self._matrices

    def _transform(self, parts: torch.Tensor, axis: int) -> torch.Tensor:
        """Compute cosine sums over a quarter along an axis (a DCT of type 2)."""
        count = parts.shape[axis]
        if count > self._length:
            # Pixels beyond half a period are aliases of those before it.
            beyond = parts.narrow(axis, self._length, count - self._length).flip(axis)
            parts = parts.narrow(axis, 0, self._length).clone()
            parts.narrow(axis, 2 * self._length - count, count - self._length).add_(beyond)
        found = scipy.fft.dct(parts.numpy(), 2, n=self._length, axis=axis, overwrite_x=True)
        return torch.from_numpy(found).narrow(axis, 0, self._reach + 1)

    def _transpose(self, parts: torch.Tensor, axis: int) -> torch.Tensor:
        """Compute the transpose of the cosine sums along an axis (a DCT of type 3)."""
        count = self._shape[axis]
        parts = parts.clone()
        parts.narrow(axis, 0, 1).mul_(2)
        found = torch.from_numpy(scipy.fft.dct(parts.numpy(), 3, n=self._length, axis=axis))
        if count > self._length:
            start = 2 * self._length - count
            found = torch.cat(
                (found, found.narrow(axis, start, count - self._length).flip(axis)), axis
            )
        return found.narrow(axis, 0, count)


class FoldedMap(FieldMap):
    """Maps the wave of a whole panel by two fast Fourier transforms of one period's length.

    shape: (rows, columns) of the panel; each less than twice `length`.
    reach: samples from the middle of the sensor to the window's border; less than half of `length`.
    length: of the transforms; the step is 1 / length turns.
    """

    def __init__(self, shape: tuple[int, int], reach: int, length: int) -> None:
        self._shape, self._length = shape, length
        self._index = torch.arange(-reach, reach + 1) % length

    def __call__(self, wave: torch.Tensor) -> torch.Tensor:
        return self._transform(self._transform(wave).mT).mT

    def adjoint(self, wave: torch.Tensor) -> torch.Tensor:
        rows, columns = self._shape
        return self._transpose(self._transpose(wave.mT, rows).mT, columns)

    def _transform(self, wave: torch.Tensor) -> torch.Tensor:
        """Compute Fourier sums over pixels along the last axis."""
        count = wave.shape[-1]
        if count > self._length:
            folded = wave[..., : self._length].clone()
            folded[..., : count - self._length] += wave[..., self._length :]
            wave = folded
        spectrum = fft(wave.contiguous(), self._length, -1)
        return spectrum.index_select(-1, self._index.to(wave.device))

    def _transpose(self, wave: torch.Tensor, count: int) -> torch.Tensor:
        """Compute the conjugate transpose of the Fourier sums along the last axis."""
        spectrum = wave.new_zeros((*wave.shape[:-1], self._length))
        spectrum[..., self._index.to(wave.device)] = wave
        found = fft(spectrum, self._length, -1, inverse=True, scaled=False, overwrite=True)
        if count > self._length:
            return torch.cat((found, found[..., : count - self._length]), -1)
        return found[..., :count]


def chirp_map(
    shape: tuple[int, int], reach: int, step: float, dtype: torch.dtype
) -> ChirpTransform:
    """Return the map of a whole panel's wave by chirp transforms, for any step.

    Its arguments are those of `CosineMatrixMap`, with the shape of the whole panel.
    """
    image = Plane((2 * reach + 1, 2 * reach + 1), (step, step))
    return ChirpTransform(FourierGeometry(Plane(shape, (1.0, 1.0)), image, 1.0), dtype)
