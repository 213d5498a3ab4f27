"""The Fourier integral from one plane to another, by whichever method is cheapest.

Every transform computes, without approximation beyond rounding,

    F(u, v) = sum over (y, x) of f(y, x) exp(-2 pi i (y u + x v) / scale)

between two planes; for a pupil and its focal plane, scale is wavelength times
distance (Goodman, Introduction to Fourier Optics; thesis Eq. 2.13 and 3.1). All of
them share one contract: call, adjoint, bytes, predicted processor time, autograd.
Phases are reduced to one turn in float64 before they are stored in single precision.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import scipy.fft
import torch
from numpy.typing import NDArray

from optics.accuracy import Budget, MachineSpeed, Method, cheapest
from optics.plane import Plane

_MANY_SAMPLES = 1 << 20


def fft(x: torch.Tensor, length: int, dim: int, *, inverse: bool = False) -> torch.Tensor:
    """One-dimensional FFT, zero-padded to `length`, by the fastest library for the case.

    scipy is faster than torch on the CPU, and has no gradients.
    """
    if _needs_torch(x):
        transform = torch.fft.ifft if inverse else torch.fft.fft
        return transform(x, n=length, dim=dim)
    function = scipy.fft.ifft if inverse else scipy.fft.fft
    return torch.from_numpy(function(_array(x), n=length, axis=dim, workers=_workers(x)))


def rfft2(x: torch.Tensor) -> torch.Tensor:
    """Two-dimensional FFT of a real picture, origin in the corner, by the fastest library."""
    if _needs_torch(x):
        return torch.fft.rfft2(x)
    return torch.from_numpy(scipy.fft.rfft2(_array(x), workers=_workers(x)))


def irfft2(x: torch.Tensor, shape: Sequence[int]) -> torch.Tensor:
    """The real picture of `shape` whose rfft2 is x."""
    if _needs_torch(x):
        return torch.fft.irfft2(x, s=tuple(shape))
    return torch.from_numpy(scipy.fft.irfft2(_array(x), s=tuple(shape), workers=_workers(x)))


def _needs_torch(x: torch.Tensor) -> bool:
    return x.device.type != "cpu" or (x.requires_grad and torch.is_grad_enabled())


def _array(x: torch.Tensor) -> NDArray[Any]:
    return x.detach().resolve_conj().numpy()


def _workers(x: torch.Tensor) -> int:
    """Threads pay only for large transforms; for small ones they wait for each other."""
    return (os.cpu_count() or 1) if x.numel() > _MANY_SAMPLES else 1


def unit_phasor(turns: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """exp(2 pi i turns) in `dtype`, from float64 turns reduced to within half a turn."""
    angle = 2 * math.pi * (turns - torch.round(turns))
    return torch.polar(torch.ones_like(angle), angle).to(dtype)


@dataclass(frozen=True)
class Geometry:
    """Two planes and the product wavelength times distance, in square metres."""

    pupil: Plane
    image: Plane
    scale: float

    def __post_init__(self) -> None:
        if not 0 < self.scale < math.inf:
            raise ValueError(
                f"scale {self.scale} m² (wavelength x distance) must be positive and finite"
            )

    def step(self, axis: int) -> float:
        """Turns of phase per pupil sample and image sample."""
        return self.pupil.pitch[axis] * self.image.pitch[axis] / self.scale


def _on(plane: Plane, field: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """The field in `dtype`; ValueError if its samples aren't those of the plane."""
    if field.shape[-2:] != plane.shape:
        raise ValueError(f"field is {tuple(field.shape)}; its plane has {plane.shape} samples")
    return field.to(dtype)


class Transform(Method, Protocol):
    """The contract of all Fourier transforms here; fields are (..., rows, columns)."""

    def __call__(self, field: torch.Tensor) -> torch.Tensor: ...

    def adjoint(self, field: torch.Tensor) -> torch.Tensor: ...


class MatrixTransform:
    """Two matrix products: best for few image samples (Soummer et al., 10.1364/OE.15.015935)."""

    name = "matrix DFT"

    def __init__(self, geometry: Geometry, dtype: torch.dtype) -> None:
        self._geometry = geometry
        self._dtype = dtype
        self._matrices: tuple[torch.Tensor, torch.Tensor] | None = None

    def _kernel(self, axis: int) -> torch.Tensor:
        g = self._geometry
        u, x = g.image.coordinates(axis), g.pupil.coordinates(axis)
        return unit_phasor(-torch.outer(u, x) / g.scale, self._dtype)

    def _kernels(self, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
        if self._matrices is None or self._matrices[0].device != device:
            self._matrices = (self._kernel(0).to(device), self._kernel(1).to(device))
        return self._matrices

    def __call__(self, field: torch.Tensor) -> torch.Tensor:
        rows, columns = self._kernels(field.device)
        return rows @ _on(self._geometry.pupil, field, self._dtype) @ columns.mT

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        rows, columns = self._kernels(field.device)
        return rows.mH @ _on(self._geometry.image, field, self._dtype) @ columns.conj()

    @property
    def bytes(self) -> int:
        (ny, nx), (my, mx) = self._geometry.pupil.shape, self._geometry.image.shape
        return self._dtype.itemsize * (my * ny + mx * nx + my * nx + my * mx)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        (ny, nx), (my, mx) = self._geometry.pupil.shape, self._geometry.image.shape
        return 4 * (my * ny * nx + my * nx * mx) * speed.multiply_add * _factor(self._dtype, speed)


class _ChirpAxis:
    """Bluestein's chirp-Z transform along one axis, for any pitch and centre."""

    def __init__(self, geometry: Geometry, axis: int, dtype: torch.dtype) -> None:
        self.n, self.m = geometry.pupil.shape[axis], geometry.image.shape[axis]
        self.length = scipy.fft.next_fast_len(self.n + self.m - 1)
        step, scale = geometry.step(axis), geometry.scale
        j = torch.arange(self.n, dtype=torch.float64) - self.n // 2
        k = torch.arange(self.m, dtype=torch.float64) - self.m // 2
        x0, u0 = geometry.pupil.centre[axis], geometry.image.centre[axis]
        tilt = u0 * geometry.pupil.pitch[axis] / scale
        self.before = unit_phasor(-step * j**2 / 2 - tilt * j, dtype)
        u = geometry.image.coordinates(axis)
        self.after = unit_phasor(-step * k**2 / 2 - x0 * u / scale, dtype)
        lag = torch.arange(-(self.n - 1), self.m, dtype=torch.float64)
        chirp = unit_phasor(step * (lag + self.n // 2 - self.m // 2) ** 2 / 2, torch.complex128)
        kernel = torch.zeros(self.length, dtype=torch.complex128)
        kernel[lag.long() % self.length] = chirp
        self.kernel = torch.fft.fft(kernel).to(dtype)

    def to(self, device: torch.device) -> None:
        if self.kernel.device != device:
            self.before, self.after = self.before.to(device), self.after.to(device)
            self.kernel = self.kernel.to(device)

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        spectrum = fft(field * self.before, self.length, -1) * self.kernel
        return fft(spectrum, self.length, -1, inverse=True)[..., : self.m] * self.after

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        spectrum = fft(field * self.after.conj(), self.length, -1) * self.kernel.conj()
        return fft(spectrum, self.length, -1, inverse=True)[..., : self.n] * self.before.conj()


class ChirpTransform:
    """Chirp-Z: any pitch and any window at the cost of a few FFTs (Rabiner et al. 1969)."""

    name = "chirp-Z"

    def __init__(self, geometry: Geometry, dtype: torch.dtype) -> None:
        self._geometry = geometry
        self._dtype = dtype
        self._axes: tuple[_ChirpAxis, _ChirpAxis] | None = None

    def _prepared(self, device: torch.device) -> tuple[_ChirpAxis, _ChirpAxis]:
        if self._axes is None:
            self._axes = tuple(_ChirpAxis(self._geometry, a, self._dtype) for a in (0, 1))  # type: ignore[assignment]
        assert self._axes is not None
        for axis in self._axes:
            axis.to(device)
        return self._axes

    def __call__(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self._prepared(field.device)
        field = _on(self._geometry.pupil, field, self._dtype)
        return y.forward(x.forward(field).mT.contiguous()).mT

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self._prepared(field.device)
        field = _on(self._geometry.image, field, self._dtype)
        return x.adjoint(y.adjoint(field.mT.contiguous()).mT.contiguous())

    def _lengths(self) -> tuple[int, int]:
        (ny, nx), (my, mx) = self._geometry.pupil.shape, self._geometry.image.shape
        return scipy.fft.next_fast_len(ny + my - 1), scipy.fft.next_fast_len(nx + mx - 1)

    @property
    def bytes(self) -> int:
        ny, mx = self._geometry.pupil.shape[0], self._geometry.image.shape[1]
        length_y, length_x = self._lengths()
        return self._dtype.itemsize * 3 * max(ny * length_x, mx * length_y)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        ny, mx = self._geometry.pupil.shape[0], self._geometry.image.shape[1]
        length_y, length_x = self._lengths()
        operations = 2 * (ny * _fft_operations(length_x) + mx * _fft_operations(length_y))
        return operations * speed.fft * _factor(self._dtype, speed)


class PrunedTransform:
    """Zero-padded FFTs of which only the wanted rows and columns are computed.

    Serves where the step is one over a whole number, both planes are centred, and
    that number is no less than either side.
    """

    name = "pruned FFT"

    def __init__(self, geometry: Geometry, dtype: torch.dtype) -> None:
        self._geometry = geometry
        self._dtype = dtype
        self._lengths = tuple(self.length(geometry, axis) for axis in (0, 1))
        if 0 in self._lengths:
            raise ValueError("this geometry has no padded length; use the chirp-Z transform")
        self._phases = [self._phase(axis) for axis in (0, 1)]

    @staticmethod
    def length(geometry: Geometry, axis: int) -> int:
        """The padded FFT length that fits the geometry along an axis; 0 if none does."""
        exact = 1 / geometry.step(axis)
        length = round(exact)
        sides = (geometry.pupil.shape[axis], geometry.image.shape[axis])
        centred = geometry.pupil.centre[axis] == geometry.image.centre[axis] == 0
        # The last sample's phase must be right to 1e-9 turns.
        error = abs(exact - length) / exact * sides[0] * sides[1] * geometry.step(axis)
        return length if centred and length >= max(sides) and error < 1e-9 else 0

    def _phase(self, axis: int) -> torch.Tensor:
        n, m = self._geometry.pupil.shape[axis], self._geometry.image.shape[axis]
        k = torch.arange(m, dtype=torch.float64) - m // 2
        return unit_phasor(k * (n // 2) / self._lengths[axis], self._dtype)

    def _index(self, axis: int, device: torch.device) -> torch.Tensor:
        m = self._geometry.image.shape[axis]
        return (torch.arange(m, device=device) - m // 2) % self._lengths[axis]

    def _forward_axis(self, field: torch.Tensor, axis: int) -> torch.Tensor:
        spectrum = fft(field, self._lengths[axis], -1)
        wanted = spectrum.index_select(-1, self._index(axis, field.device))
        return wanted * self._phases[axis].to(field.device)

    def _adjoint_axis(self, field: torch.Tensor, axis: int) -> torch.Tensor:
        length, n = self._lengths[axis], self._geometry.pupil.shape[axis]
        padded = field.new_zeros((*field.shape[:-1], length))
        values = field * self._phases[axis].conj().to(field.device)
        padded = padded.index_copy(-1, self._index(axis, field.device), values)
        return fft(padded, length, -1, inverse=True)[..., :n] * length

    def __call__(self, field: torch.Tensor) -> torch.Tensor:
        rows = self._forward_axis(_on(self._geometry.pupil, field, self._dtype), 1)
        return self._forward_axis(rows.mT.contiguous(), 0).mT

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        field = _on(self._geometry.image, field, self._dtype)
        columns = self._adjoint_axis(field.mT.contiguous(), 0)
        return self._adjoint_axis(columns.mT.contiguous(), 1)

    @property
    def bytes(self) -> int:
        ny, mx = self._geometry.pupil.shape[0], self._geometry.image.shape[1]
        return self._dtype.itemsize * 2 * max(ny * self._lengths[1], mx * self._lengths[0])

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        ny, mx = self._geometry.pupil.shape[0], self._geometry.image.shape[1]
        operations = ny * _fft_operations(self._lengths[1]) + mx * _fft_operations(self._lengths[0])
        return operations * speed.fft * _factor(self._dtype, speed)


def _fft_operations(length: int) -> float:
    return 5 * length * math.log2(max(length, 2))


def _factor(dtype: torch.dtype, speed: MachineSpeed) -> float:
    return speed.double_factor if dtype == torch.complex128 else 1.0


def transforms(geometry: Geometry, dtype: torch.dtype) -> list[Transform]:
    """Every transform that is valid for a geometry."""
    found: list[Transform] = [MatrixTransform(geometry, dtype), ChirpTransform(geometry, dtype)]
    if all(PrunedTransform.length(geometry, axis) for axis in (0, 1)):
        found.append(PrunedTransform(geometry, dtype))
    return found


def plan_transform(
    geometry: Geometry,
    dtype: torch.dtype = torch.complex64,
    budget: Budget | None = None,
    method: str | None = None,
) -> Transform:
    """The cheapest valid transform for a geometry, or the one that `method` names.

    Raises ToleranceError without memory, ValueError if the named one isn't valid here.
    """
    what = f"a transform from {geometry.pupil.shape} to {geometry.image.shape} samples"
    valid = transforms(geometry, dtype)
    chosen = [t for t in valid if method in (None, t.name)]
    if not chosen:
        names = ", ".join(t.name for t in valid)
        raise ValueError(f"method is {method!r}; for {what} choose one of {names}")
    return cheapest(chosen, budget or Budget(), what)
