"""Fresnel's integral as two products with matrices, exact to rounding."""

from __future__ import annotations

import torch

from optics.accuracy import ErrorEstimate, MachineSpeed
from optics.propagation.fresnel_integral import band_kernel, cell_kernel
from optics.propagation.paraxial import ParaxialPropagator
from optics.propagation.precision import working_precision
from optics.propagation.span import FreeSpaceSpan

_BLOCK = 1 << 20
"""Elements of a matrix that are made at once."""

_BLOCK_BYTES = 160
"""For each of them, while they are made."""

_ELEMENT_TOUCHES = 1500
"""What an element costs to make, two values of Faddeeva's function included."""


class FresnelMatrices(ParaxialPropagator):
    """The paraxial kernel is a product of one along y and one along x, so that

        target = rows · source · columns^T,

    with a matrix for each axis (thesis Eq. 2.12, Goodman 4.2). Their elements are Fresnel
    integrals in closed form, over a cell or over a smooth field's band (optics.propagation.
    fresnel_integral): nothing is sampled, and any two planes will do, however near.
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
        """Of the kernel between the points that are farthest from each other; a smooth field
        has no faster phase than its own fringes give it."""
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

    def _matrix(self, axis: int) -> torch.Tensor:
        """(target's samples, source's samples) along an axis."""
        source, target = self.span.source, self.span.target
        pitch = source.pitch[axis]
        m, n = target.shape[axis], source.shape[axis]
        if abs(target.pitch[axis] - pitch) * max(m, n) < 1e-15 * pitch:
            return self._toeplitz_matrix(axis)
        x = source.coordinates(axis)
        rows = max(1, _BLOCK // n)
        parts = [
            self._kernel_values(axis, part[:, None] - x).to(self.dtype)
            for part in torch.split(target.coordinates(axis), rows)
        ]
        return torch.cat(parts)

    def _toeplitz_matrix(self, axis: int) -> torch.Tensor:
        """Between samples that are equally far apart it takes one value for each lag."""
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
        # Whole matrices are recorded for their derivatives.
        whole = self.span.differentiable
        made = self._elements() if whole else min(self._elements(), _BLOCK)
        kept = self._elements() + between + my * mx
        return self.dtype.itemsize * kept + _BLOCK_BYTES * made

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        (ny, nx), (my, mx) = self.span.source.shape, self.span.target.shape
        products = min(my * nx * (ny + mx), ny * mx * (nx + my))
        seconds = (4 * products * speed.multiply_add + my * mx * speed.touch) * self._slowness(
            speed
        )
        if self.span.differentiable:
            seconds += self._elements() * _ELEMENT_TOUCHES * speed.touch
        return speed.call + seconds
