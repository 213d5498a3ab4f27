"""The non-uniform FFT, from scattered points in the pupil to a regularly sampled image."""

from __future__ import annotations

import math
from typing import Any

import finufft
import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import MachineSpeed
from optics.fourier.fft import fft_operations
from optics.fourier.fitted_interpolation import interpolation_width
from optics.fourier.transform import Transform
from optics.plane import Plane

FINEST_NUFFT = 1e-14
"""The smallest relative error that finufft takes in double precision."""

FINEST_COARSE_NUFFT = 1e-8
"""The smallest relative error that finufft reaches on its coarser internal grid."""

_OVERSAMPLING = 2.0  # samples of finufft's internal grid per image sample along an axis

_COARSE_OVERSAMPLING = 1.25  # the same for the coarser grid


class NonuniformTransform(Transform):
    """Sums the waves of points at arbitrary positions, to a stated error.

    It uses the type 1 transform of finufft in double precision. In single precision, the rounding
    of the positions alone would cause an error of 1e-4 in a large window. It runs on the CPU;
    fields on other devices are copied there and back. Fields are (..., points).

    Parameters
    ----------
    y : torch.Tensor
        The points' y positions in metres, one-dimensional.
    x : torch.Tensor
        The points' x positions in metres, of the same length.
    image : Plane
        Where the field is computed.
    scale : float
        Wavelength times distance in square metres.
    error : float
        L2 error relative to the light that the whole image plane receives; at least 1e-8 with
        `few_points`.
    few_points : bool, optional
        Whether there are far fewer points than image samples. finufft then uses a coarser grid, and
        spreads each point over more of it.

    Raises
    ------
    ValueError
        For an error below 1e-8 with `few_points`.

    References
    ----------
    A. H. Barnett, J. Magland and L. af Klinteberg, 2019, doi 10.1137/18M120885X.
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
        if few_points and error < FINEST_COARSE_NUFFT:
            raise ValueError(f"error is {error:g}; for few points it is 1e-08 or more")
        self.image, self.scale, self.error = image, scale, max(error, FINEST_NUFFT)
        self._y, self._x = y, x
        self._few_points = few_points
        self._oversampling = _COARSE_OVERSAMPLING if few_points else _OVERSAMPLING
        self._angles = [
            (2 * math.pi * pitch / scale * p.numpy())
            for pitch, p in zip(image.pitch, (y, x), strict=True)
        ]
        centre = [float(c) for c in image.centre]
        tilt = -(y * centre[0] + x * centre[1]) / scale
        self._tilt = np.exp(2j * math.pi * tilt.numpy()) if any(centre) else None
        self._plans: dict[int, Any] = {}

    def positions(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the points' positions (y, x) in metres."""
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

    @property
    def bytes(self) -> int:
        """Bytes of the largest arrays."""
        return nonuniform_bytes(self._y.numel(), self.image)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of one call at a machine's speed."""
        count = self._y.numel()
        return nonuniform_seconds(count, self.image, self.error, speed, few_points=self._few_points)


def nonuniform_bytes(points: int, image: Plane) -> int:
    """Predict the memory in bytes for a number of points, before anything is built."""
    samples = image.shape[0] * image.shape[1]
    # Each point takes 72 bytes: its position, its values before and after, and its place in the
    # order in which finufft sorts the points.
    return 72 * points + math.ceil(16 * (_OVERSAMPLING**2 + 2) * samples)


def nonuniform_seconds(
    points: int, image: Plane, error: float, speed: MachineSpeed, *, few_points: bool = False
) -> float:
    """Predict the processor time in seconds for a number of points, before anything is built."""
    oversampling = _COARSE_OVERSAMPLING if few_points else _OVERSAMPLING
    # Over how many grid points per axis finufft spreads each point.
    width = math.ceil(-math.log10(error)) + 1
    if few_points:
        width = interpolation_width(1 / oversampling, error)
    width = max(2, width)
    rows, columns = (math.ceil(oversampling * n) for n in image.shape)
    transform = rows * fft_operations(columns) + columns * fft_operations(rows)
    spread = points * (speed.point + width**2 * speed.spread)
    seconds = transform * speed.fft + oversampling * rows * image.shape[1] * speed.touch
    return speed.call + spread + seconds * speed.double
