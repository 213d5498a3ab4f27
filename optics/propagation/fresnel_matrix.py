"""Fresnel integrals in closed form, and the method that applies them as matrix products."""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import wofz

from optics.accuracy import ErrorEstimate, MachineSpeed
from optics.fourier import unit_phasor
from optics.fourier.differentiation import apply_function
from optics.gauss_legendre import gauss_legendre
from optics.propagation.paraxial import ParaxialPropagator
from optics.propagation.propagator import working_precision
from optics.propagation.span import FreeSpaceSpan

_Reals = NDArray[np.float64]
_Complexes = NDArray[np.complex128]

_ROOT_I = cmath.exp(0.25j * math.pi)
_NODES, _WEIGHTS = gauss_legendre(14)

_PART = 1 << 18  # number of integrals that are computed at once


def mean_chirp(place: torch.Tensor, width: torch.Tensor) -> torch.Tensor:
    """Return the mean of exp(i pi (u² + 2 u place)) over ``|u| < width / 2``, complex128.

    place: real tensor. width: 0-d tensor, positive. This mean is an interval's Fresnel integral
    after division by its width and by the chirp at its centre. With v = u + place,

        integral of exp(i pi v²) from t on = exp(i pi t²) g(t), t > 0,
        g(t) = w(exp(i pi / 4) sqrt(pi) t) exp(i pi / 4) / 2,

    where w is Faddeeva's function (Abramowitz and Stegun 7.3.22, 7.1.3). So no two large phases
    are subtracted: the phases at the ends are pi (width² / 4 ± width place). Over short intervals,
    where the terms of the two ends would cancel, a Gauss-Legendre sum is used instead. The result
    is differentiable in both arguments.
    """
    return apply_function(_MeanChirp, place, width)


class _MeanChirp(torch.autograd.Function):
    """Differentiate mean_chirp() in closed form, from the values at the interval's ends."""

    @staticmethod
    def forward(ctx: Any, place: torch.Tensor, width: torch.Tensor) -> torch.Tensor:
        values = _mean_chirps(place.detach().cpu().numpy().ravel(), float(width.detach()))
        mean = torch.from_numpy(values).reshape(place.shape).to(place.device)
        ctx.save_for_backward(place, width, mean)
        return mean

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        place, width, mean = ctx.saved_tensors
        end = unit_phasor(width**2 / 8, torch.complex128).to(place.device)
        angle = math.pi * torch.remainder(width * place, 2)
        in_place = 2j * (end * torch.sin(angle) / width - math.pi * place * mean)
        in_width = (end * torch.cos(angle) - mean) / width
        return (gradient.conj() * in_place).real, (gradient.conj() * in_width).real.sum().to(width)


def _mean_chirps(place: _Reals, width: float) -> _Complexes:
    """Compute mean_chirp() for an array of places, block by block."""
    means = np.empty(place.size, dtype=np.complex128)
    for start in range(0, place.size, _PART):
        t = np.abs(place[start : start + _PART])
        # 14 Gauss-Legendre nodes are exact to rounding up to 2 rad of phase over half the interval.
        short = math.pi * width * (t + width / 4) <= 2.0
        part = np.zeros(t.size, dtype=np.complex128)
        for node, weight in zip(_NODES * width / 2, _WEIGHTS / 2, strict=True):
            part[short] += weight * np.exp(1j * math.pi * node * (node + 2 * t[short]))
        part[~short] = _mean_by_end_terms(t[~short], width)
        means[start : start + _PART] = part
    return means


def _mean_by_end_terms(t: _Reals, width: float) -> _Complexes:
    """Compute mean_chirp() of long intervals from the integrals beyond both ends.

    For t < width / 2, the near end of the interval is on the other side of the chirp's centre.
    """
    near = t - width / 2
    whole = np.where(near < 0, _ROOT_I * _phasor(-(t**2)), 0.0)
    side = np.where(near < 0, -1.0, 1.0)
    last = _phasor(width**2 / 4 - width * t) * _scaled_tail_integral(np.abs(near)) * side
    first = _phasor(width**2 / 4 + width * t) * _scaled_tail_integral(t + width / 2)
    return np.asarray((whole + last - first) / width, dtype=np.complex128)


def _scaled_tail_integral(t: _Reals) -> _Complexes:
    """Return exp(-i pi t²) times the integral of exp(i pi v²) from t >= 0 to infinity."""
    return np.asarray(0.5 * _ROOT_I * wofz(_ROOT_I * math.sqrt(math.pi) * t))


def _phasor(half_turns: _Reals) -> _Complexes:
    """Return exp(i pi half_turns)."""
    angle = math.pi * (half_turns - 2 * np.round(half_turns / 2))
    return np.cos(angle) + 1j * np.sin(angle)


def cell_envelope(offset: torch.Tensor, side: float, scale: torch.Tensor) -> torch.Tensor:
    """Return a cell's paraxial field along an axis, over that of its centre point.

    offset: metres from the cell's centre to the target. side: metres. scale: wavelength times
    distance in square metres, not 0; a 0-d tensor. The result is the mean of
    exp(i pi (d² - 2 d offset) / scale) over |d| < side / 2.
    """
    root = torch.sqrt(torch.abs(scale))
    mean = mean_chirp(offset / root, side / root)
    return mean if float(scale.detach()) > 0 else mean.conj()


def cell_kernel(offset: torch.Tensor, side: float, scale: torch.Tensor) -> torch.Tensor:
    """Return the paraxial field along one axis of a cell of amplitude 1.

    It is the integral of exp(i pi (offset - d)² / scale) / sqrt(i scale) over |d| < side / 2; the
    field of a rectangle is the product of two.
    """
    return side * point_kernel(offset, scale) * cell_envelope(offset, side, scale)


def point_kernel(offset: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
    """Return the impulse response along one axis, exp(i pi offset² / scale) / sqrt(i scale)."""
    turn = -0.125 if float(scale.detach()) > 0 else 0.125
    phasor = unit_phasor(offset**2 / (2 * scale) + turn, torch.complex128)
    return phasor / torch.sqrt(torch.abs(scale))


def band_kernel(
    offset: torch.Tensor, pitch: float, carrier: float, scale: torch.Tensor
) -> torch.Tensor:
    """Return the paraxial field of one band-limited sample along one axis.

    It is pitch times the integral of exp(-i pi scale f² + 2 pi i f offset) over the frequencies f
    within 0.5 / pitch of the carrier, which is a Fresnel integral over the spectrum.
    """
    root = torch.sqrt(torch.abs(scale))
    mean = mean_chirp((offset - scale * carrier) / root, root / pitch)
    turns = carrier * offset - scale * (carrier**2 / 2)
    mean = mean.conj() if float(scale.detach()) > 0 else mean
    return unit_phasor(turns, torch.complex128) * mean


_BLOCK_ELEMENTS = 1 << 20  # number of matrix elements that are computed at once. Chosen.

# Memory in bytes per element while it is computed, and processor time per element, in passes over
# one complex number. The time includes two values of Faddeeva's function.
_ELEMENT_BYTES, _ELEMENT_TOUCHES = 160, 1500


class FresnelMatrices(ParaxialPropagator):
    """Compute Fresnel's integral with one matrix for each axis.

    The paraxial kernel is the product of a kernel along y and one along x (thesis Eq. 2.12,
    section 4.2 of Goodman), so

        target = rows · source · columns^T.

    The elements are Fresnel integrals in closed form, over a cell or over a smooth field's band.
    There is no sampling error, however close the planes are.
    """

    name = "Fresnel matrices"

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        # The kernel's phase between the two most distant points, in turns. That of a smooth field
        # is limited by the field's own fringes.
        n, most = self._paraxial_span.numeric, 0.0
        for axis in (0, 1):
            way = max(map(abs, n.lateral_range(axis)))
            turns = way**2 / (2 * abs(n.scale))
            if n.cells is None:
                fringe = abs(n.carrier[axis]) + 0.5 / n.source.pitch[axis]
                turns = min(turns, way * fringe)
            most = max(most, turns)
        self.dtype, self.arithmetic = working_precision(span.tol - self._model_error, most)
        self.error = ErrorEstimate(self._model_error, "bound")
        (ny, nx), (my, mx) = span.source.shape, span.target.shape
        self.sampling = f"{my}x{ny} and {nx}x{mx} matrices"
        self._elements = my * ny + mx * nx
        rows_first, columns_first = my * nx * (ny + mx), ny * mx * (nx + my)
        self._rows_first = rows_first <= columns_first
        self._products = min(rows_first, columns_first)
        self._cached_matrices: tuple[torch.Tensor, torch.Tensor] | None = None

    def _kernel_values(self, axis: int, way: torch.Tensor) -> torch.Tensor:
        span = self._paraxial_span
        scale = torch.as_tensor(span.scale, dtype=torch.float64, device="cpu")
        if span.cells is not None:
            return cell_kernel(way, span.cells[axis], scale)
        return band_kernel(way, span.source.pitch[axis], span.carrier[axis], scale)

    def _is_toeplitz(self, axis: int) -> bool:
        """Return whether source and target have the same pitch along an axis."""
        source, target = self.span.source, self.span.target
        longest = max(source.shape[axis], target.shape[axis])
        unlike = abs(target.pitch[axis] - source.pitch[axis])
        return unlike * longest < 1e-15 * source.pitch[axis]

    def _matrix(self, axis: int) -> torch.Tensor:
        """Compute the matrix (target samples, source samples) along an axis."""
        source, target = self.span.source, self.span.target
        m, n = target.shape[axis], source.shape[axis]
        if not self._is_toeplitz(axis):
            x = source.coordinates(axis)
            parts = [
                self._kernel_values(axis, part[:, None] - x).to(self.dtype)
                for part in torch.split(target.coordinates(axis), max(1, _BLOCK_ELEMENTS // n))
            ]
            return torch.cat(parts)
        # Between planes of equal pitch, one value suffices for each lag.
        lag = torch.arange(m + n - 1, dtype=torch.float64) - (n - 1) + n // 2 - m // 2
        way = lag * source.pitch[axis] + (target.centre[axis] - source.centre[axis])
        index = torch.arange(m)[:, None] - torch.arange(n) + (n - 1)
        return self._kernel_values(axis, way).to(self.dtype)[index]

    def _matrices(self, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
        if self.span.differentiable and torch.is_grad_enabled():
            return self._matrix(0).to(device), self._matrix(1).to(device)
        if self._cached_matrices is None or self._cached_matrices[0].device != device:
            with torch.no_grad():
                self._cached_matrices = (self._matrix(0).to(device), self._matrix(1).to(device))
        return self._cached_matrices

    def prepare(self) -> None:
        if not self.span.differentiable:
            self._matrices(torch.device("cpu"))

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        rows, columns = self._matrices(field.device)
        field = field.to(self.dtype)
        if self._rows_first:
            return (rows @ field) @ columns.mT
        return rows @ (field @ columns.mT)

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        rows, columns = self._matrices(field.device)
        field = field.to(self.dtype)
        if self._rows_first:
            return rows.mH @ (field @ columns.conj())
        return (rows.mH @ field) @ columns.conj()

    @property
    def bytes(self) -> int:
        (ny, nx), (my, mx) = self.span.source.shape, self.span.target.shape
        between = my * nx if self._rows_first else ny * mx
        # Derivatives are recorded for whole matrices, not block by block.
        whole = self.span.differentiable
        made = self._elements if whole else min(self._elements, _BLOCK_ELEMENTS)
        kept = self._elements + between + my * mx
        return self.dtype.itemsize * kept + _ELEMENT_BYTES * made

    def planning_seconds(self, speed: MachineSpeed) -> float:
        if self.span.differentiable:
            return 0.0
        values = 0
        for axis, (m, n) in enumerate(
            zip(self.span.target.shape, self.span.source.shape, strict=True)
        ):
            values += m + n - 1 if self._is_toeplitz(axis) else m * n
        return values * _ELEMENT_TOUCHES * speed.touch + 5 * speed.call

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        touched = math.prod(self.span.target.shape)
        seconds = 4 * self._products * speed.multiply_add + touched * speed.touch
        seconds *= speed.slowdown(self.dtype)
        if self.span.differentiable:
            seconds += self._elements * _ELEMENT_TOUCHES * speed.touch
        return speed.call + seconds
