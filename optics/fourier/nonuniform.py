"""From scattered points in the pupil to a regular image, by the non-uniform FFT."""

from __future__ import annotations

import math
from typing import Any

import finufft
import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft_operations
from optics.fourier.transform import Transform
from optics.plane import Plane

FINEST_NUFFT = 1e-14
"""The smallest relative error that finufft takes in double precision."""

_FINER, _FINER_OF_FEW = 2.0, 1.25
_FINEST_OF_FEW = 1e-8
_BYTES_A_POINT = 72
"""Positions, values before and after, and finufft's own order of the points."""


class NonuniformTransform(Transform):
    """The Fourier sum over points wherever they lie, to a stated error.

    finufft's type 1 (Barnett, Magland and af Klinteberg 2019, 10.1137/18M120885X), in
    double precision: in single, positions alone would cost 1e-4 in a large window. It
    runs on the CPU; fields on other devices travel there and back.

    y, x: metres, one-dimensional and of the same length. image: where the field is
    wanted. scale: wavelength times distance, m². error: relative L2, of the light that
    the whole plane receives, 1e-8 or more for few points: of those, far fewer than samples, each
    is spread over more of a grid that is less fine. Fields are (..., points).
    """

    name = "non-uniform FFT"
    dtype = torch.complex128

    def __init__(
        self,
        y: torch.Tensor,
        x: torch.Tensor,
        image: Plane,
        scale: float,
        error: float,
        *,
        few_points: bool = False,
    ) -> None:
        if few_points and error < _FINEST_OF_FEW:
            raise ValueError(f"error is {error:g}; for few points it is {_FINEST_OF_FEW:g} or more")
        self.image, self.scale, self.error = image, scale, max(error, FINEST_NUFFT)
        self._y, self._x = y, x
        self._oversampling = _FINER_OF_FEW if few_points else _FINER
        self._angles = [
            (2 * math.pi * pitch / scale * p.numpy())
            for pitch, p in zip(image.pitch, (y, x), strict=True)
        ]
        centre = [float(c) for c in image.centre]
        tilt = -(y * centre[0] + x * centre[1]) / scale
        self._tilt = np.exp(2j * math.pi * tilt.numpy()) if any(centre) else None
        self._plans: dict[int, Any] = {}

    def positions(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._y, self._x

    def _plan(self, kind: int) -> Any:
        if kind not in self._plans:
            plan = finufft.Plan(
                kind,
                self.image.shape,
                eps=self.error,
                isign=-1 if kind == 1 else 1,
                dtype="complex128",
                nthreads=torch.get_num_threads(),
                upsampfac=self._oversampling,
                showwarn=0,
            )
            plan.setpts(*self._angles)
            self._plans[kind] = plan
        return self._plans[kind]

    def _require_samples(self, field: torch.Tensor) -> None:
        if field.shape[-1] != self._y.numel():
            raise ValueError(f"field is {tuple(field.shape)}; there are {self._y.numel()} points")

    def _forward(self, field: torch.Tensor) -> torch.Tensor:
        values = self._as_complex128_array(field)
        if self._tilt is not None:
            values = values * self._tilt
        flat = values.reshape(-1, values.shape[-1])
        done = np.stack([self._plan(1).execute(np.ascontiguousarray(v)) for v in flat])
        return torch.from_numpy(done.reshape(*field.shape[:-1], *self.image.shape)).to(field.device)

    def _adjoint(self, field: torch.Tensor) -> torch.Tensor:
        values = self._as_complex128_array(field)
        flat = values.reshape(-1, *values.shape[-2:])
        done = np.stack([self._plan(2).execute(np.ascontiguousarray(v)) for v in flat])
        if self._tilt is not None:
            done = done * self._tilt.conj()
        return torch.from_numpy(done.reshape(*field.shape[:-2], -1)).to(field.device)

    def _as_complex128_array(self, field: torch.Tensor) -> NDArray[np.complex128]:
        return field.detach().cpu().to(torch.complex128).resolve_conj().numpy()

    @staticmethod
    def width(error: float) -> int:
        """Grid points that a point is spread over along an axis."""
        return max(2, math.ceil(-math.log10(error)) + 1)

    @property
    def bytes(self) -> int:
        return nonuniform_bytes(self._y.numel(), self.image)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return nonuniform_seconds(self._y.numel(), self.image, self.error, speed)


def nonuniform_bytes(points: int, image: Plane) -> int:
    """What a transform of so many points takes, without making it."""
    samples = image.shape[0] * image.shape[1]
    return _BYTES_A_POINT * points + math.ceil(16 * (_FINER**2 + 2) * samples)


def nonuniform_seconds(points: int, image: Plane, error: float, speed: MachineSpeed) -> float:
    """What a transform of so many points costs, without making it."""
    width = NonuniformTransform.width(error)
    rows, columns = (math.ceil(_FINER * n) for n in image.shape)
    transform = rows * fft_operations(columns) + columns * fft_operations(rows)
    spread = points * (speed.point + width**2 * speed.spread)
    seconds = transform * speed.fft + _FINER * rows * image.shape[1] * speed.touch
    return speed.call + spread + seconds * speed.double
