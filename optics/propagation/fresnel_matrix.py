"""Propagate light by Fresnel's integral as two matrix products, exact to rounding."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.accuracy import ErrorEstimate, MachineSpeed
from optics.propagation.fresnel_integral import band_kernel, cell_kernel
from optics.propagation.paraxial import ParaxialPropagator
from optics.propagation.precision import working_precision
from optics.propagation.span import FreeSpaceSpan


@dataclass(frozen=True)
class FresnelMatrixSettings:
    """Tune how the matrices of Fresnel's integral are computed, and predict the cost.

    Attributes
    ----------
    block_elements : int
        Number of matrix elements that are computed at once. Chosen.
    element_bytes : int
        Memory in bytes per element while it is computed.
    element_touches : int
        Processor time per element, in passes over one complex number. It includes two values of
        Faddeeva's function.
    """

    block_elements: int = 1 << 20
    element_bytes: int = 160
    element_touches: int = 1500


_SETTINGS = FresnelMatrixSettings()


class FresnelMatrices(ParaxialPropagator):
    """Propagate by Fresnel's integral, with one matrix for each axis.

    The paraxial kernel is the product of a kernel along y and one along x (thesis Eq. 2.12,
    section 4.2 of Goodman), so

        target = rows · source · columns^T.

    The elements of the matrices are Fresnel integrals in closed form, over a cell or over a smooth
    field's band (optics.propagation.fresnel_integral). There is no sampling error, however close
    the planes are.
    """

    name = "Fresnel matrices"

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        self.dtype, self.arithmetic = working_precision(span.tol - self._model_error, self._turns())
        self.error = ErrorEstimate(self._model_error, "bound")
        (ny, nx), (my, mx) = span.source.shape, span.target.shape
        self.sampling = f"{my}x{ny} and {nx}x{mx} matrices"
        self._cached_matrices: tuple[torch.Tensor, torch.Tensor] | None = None

    def _turns(self) -> float:
        """Return the propagation kernel's phase between the two most distant points, in turns.

        The phase of a smooth field is limited by the field's own fringes.
        """
        n, most = self._paraxial_span.numeric, 0.0
        for axis in (0, 1):
            way = max(map(abs, n.lateral_range(axis)))
            turns = way**2 / (2 * abs(n.scale))
            if n.cells is None:
                fringe = abs(n.carrier[axis]) + 0.5 / n.source.pitch[axis]
                turns = min(turns, way * fringe)
            most = max(most, turns)
        return most

    def _kernel_values(self, axis: int, way: torch.Tensor) -> torch.Tensor:
        span = self._paraxial_span
        scale = torch.as_tensor(span.scale, dtype=torch.float64, device="cpu")
        if span.cells is not None:
            return cell_kernel(way, span.cells[axis], scale)
        return band_kernel(way, span.source.pitch[axis], span.carrier[axis], scale)

    def _is_toeplitz(self, axis: int) -> bool:
        """Return whether source and target of the propagation have the same pitch along an axis."""
        source, target = self.span.source, self.span.target
        longest = max(source.shape[axis], target.shape[axis])
        unlike = abs(target.pitch[axis] - source.pitch[axis])
        return unlike * longest < 1e-15 * source.pitch[axis]

    def _kernel_count(self) -> int:
        """Return how many values of the propagation kernels the two matrices need."""
        sides = zip(self.span.target.shape, self.span.source.shape, strict=True)
        return sum(m + n - 1 if self._is_toeplitz(a) else m * n for a, (m, n) in enumerate(sides))

    def _matrix(self, axis: int) -> torch.Tensor:
        """Compute the Fresnel propagation matrix (target samples, source samples) along an axis."""
        source, target = self.span.source, self.span.target
        n = source.shape[axis]
        if self._is_toeplitz(axis):
            return self._toeplitz_matrix(axis)
        x = source.coordinates(axis)
        rows = max(1, _SETTINGS.block_elements // n)
        parts = [
            self._kernel_values(axis, part[:, None] - x).to(self.dtype)
            for part in torch.split(target.coordinates(axis), rows)
        ]
        return torch.cat(parts)

    def _toeplitz_matrix(self, axis: int) -> torch.Tensor:
        """Compute the Fresnel propagation matrix between planes of equal pitch.

        The kernel is computed once for each lag.
        """
        source, target = self.span.source, self.span.target
        m, n = target.shape[axis], source.shape[axis]
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

    @property
    def _rows_first(self) -> bool:
        (ny, nx), (my, mx) = self.span.source.shape, self.span.target.shape
        return my * nx * (ny + mx) <= ny * mx * (nx + my)

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

    def _elements(self) -> int:
        (ny, nx), (my, mx) = self.span.source.shape, self.span.target.shape
        return my * ny + mx * nx

    @property
    def bytes(self) -> int:
        (ny, nx), (my, mx) = self.span.source.shape, self.span.target.shape
        between = my * nx if self._rows_first else ny * mx
        # Derivatives are recorded for whole matrices, not block by block.
        whole = self.span.differentiable
        made = self._elements() if whole else min(self._elements(), _SETTINGS.block_elements)
        kept = self._elements() + between + my * mx
        return self.dtype.itemsize * kept + _SETTINGS.element_bytes * made

    def planning_seconds(self, speed: MachineSpeed) -> float:
        if self.span.differentiable:
            return 0.0
        return self._kernel_count() * _SETTINGS.element_touches * speed.touch + 5 * speed.call

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        (ny, nx), (my, mx) = self.span.source.shape, self.span.target.shape
        products = min(my * nx * (ny + mx), ny * mx * (nx + my))
        seconds = (4 * products * speed.multiply_add + my * mx * speed.touch) * self._slowness(
            speed
        )
        if self.span.differentiable:
            seconds += self._elements() * _SETTINGS.element_touches * speed.touch
        return speed.call + seconds
