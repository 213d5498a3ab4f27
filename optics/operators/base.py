"""The contract of all forward operators."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import torch

from optics.operators.gram import GramOperator
from optics.validation import accepts_numpy

Shape = tuple[int, ...]

_POWER_STEPS = 100
_CONVERGENCE_TOL = 1e-4


class Operator(ABC):
    """Base class of all forward operators: a linear map A between real arrays.

    Differentiable. ``first_then = then @ first`` chains operators, ``+`` adds them, and ``.T`` is
    the transpose as an operator of its own. A call and `adjoint` raise ValueError for an array
    whose last axes have another shape.

    Attributes
    ----------
    domain : tuple of int
        Shape of the last axes of x. Axes before them are a batch.
    codomain : tuple of int
        Shape of the last axes of A x.
    """

    domain: Shape
    codomain: Shape

    @abstractmethod
    def _forward(self, x: torch.Tensor) -> torch.Tensor: ...

    @abstractmethod
    def _adjoint(self, y: torch.Tensor) -> torch.Tensor: ...

    @property
    @abstractmethod
    def bytes(self) -> int:
        """The bytes that one call takes besides its input and its output."""

    @property
    def gram(self) -> GramOperator | None:
        """The operator A^T A where some basis makes it diagonal, else None."""
        return None

    @accepts_numpy
    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """Apply the operator: A x."""
        _require_shape("x", x, self.domain)
        return self._forward(x)

    @accepts_numpy
    def adjoint(self, y: torch.Tensor) -> torch.Tensor:
        """Apply the transpose: A^T y, so that <A x, y> = <x, A^T y>."""
        _require_shape("y", y, self.codomain)
        return self._adjoint(y)

    def norm(self) -> float:
        """Compute the operator norm, the largest |A x| of |x| = 1.

        It is exact where A^T A is known as a GramOperator. Otherwise it is by power iteration,
        which approaches the norm from below.
        """
        gram = self.gram
        return math.sqrt(gram.largest_eigenvalue) if gram else self._norm_by_power()

    def _norm_by_power(self) -> float:
        x = torch.rand(self.domain, generator=torch.Generator().manual_seed(0)) + 0.5
        found = 0.0
        for _ in range(_POWER_STEPS):
            length = float(torch.linalg.vector_norm(x))
            if length == 0:
                return 0.0
            x = self._adjoint(self._forward(x / length))
            before, found = found, math.sqrt(float(torch.linalg.vector_norm(x)))
            if abs(found - before) <= _CONVERGENCE_TOL * found:
                break
        return found

    @property
    def T(self) -> Operator:
        """The transpose as an operator of its own."""
        return _Transpose(self)

    def __matmul__(self, first: Operator) -> Operator:
        from optics.operators.combined import OperatorProduct

        return OperatorProduct(first, self)

    def __add__(self, other: Operator) -> Operator:
        from optics.operators.combined import OperatorSum

        return OperatorSum(self, other)


class _Transpose(Operator):
    """The adjoint of another operator."""

    def __init__(self, of: Operator) -> None:
        self._of = of
        self.domain, self.codomain = of.codomain, of.domain

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        return self._of._adjoint(x)

    def _adjoint(self, y: torch.Tensor) -> torch.Tensor:
        return self._of._forward(y)

    @property
    def bytes(self) -> int:
        return self._of.bytes

    @property
    def T(self) -> Operator:
        return self._of

    def norm(self) -> float:
        return self._of.norm()


def _require_shape(name: str, array: torch.Tensor, shape: Shape) -> None:
    if tuple(array.shape[-len(shape) :]) != shape:
        raise ValueError(f"{name} is {tuple(array.shape)}; its last axes must be {shape}")
