"""The base class of all forward operators, which defines their interface."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import torch

from optics.operators.gram import Domain, GramOperator, squared_modulus
from optics.validation import accepts_numpy

Shape = tuple[int, ...]


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
        """The memory in bytes that one call of the operator needs besides input and output."""

    @property
    def diagonal(self) -> tuple[Domain, torch.Tensor] | None:
        """The factors of a forward operator that only multiplies pixels or frequencies, else None.

        They stand behind the domain's name.
        """
        return None

    @property
    def gram(self) -> GramOperator | None:
        """The forward operator's A^T A if it has a simple closed form, else None.

        See GramOperator.
        """
        if self.diagonal is None:
            return None
        domain, values = self.diagonal
        shape = int(self.domain[-2]), int(self.domain[-1])
        return GramOperator(domain, squared_modulus(values), shape)

    def gram_with(self, then: GramOperator) -> GramOperator | None:
        """Return the Gram operator of B A if it has a closed form, for the `then` of B, else None.

        A is this forward operator.
        """
        return None if self.diagonal is None else then.after_diagonal(*self.diagonal)

    @accepts_numpy
    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """Apply the forward operator A to `x`."""
        _require_shape("x", x, self.domain)
        return self._forward(x)

    @accepts_numpy
    def adjoint(self, y: torch.Tensor) -> torch.Tensor:
        """Apply the operator's adjoint A^T to `y`, defined by <A x, y> = <x, A^T y>."""
        _require_shape("y", y, self.codomain)
        return self._adjoint(y)

    def norm(self) -> float:
        """Compute the operator norm, the largest ``|A x|`` over all x of norm 1.

        It is exact where A^T A is known as a GramOperator. Otherwise a power iteration approaches
        the norm from below.
        """
        gram = self.gram
        return math.sqrt(gram.largest_eigenvalue) if gram else self._norm_by_power()

    def _norm_by_power(self) -> float:
        """Approximate the operator's norm from below by at most 100 steps of power iteration."""
        x = torch.rand(self.domain, generator=torch.Generator().manual_seed(0)) + 0.5
        found = 0.0
        for _ in range(100):
            length = float(torch.linalg.vector_norm(x))
            if length == 0:
                return 0.0
            x = self._adjoint(self._forward(x / length))
            before, found = found, math.sqrt(float(torch.linalg.vector_norm(x)))
            if abs(found - before) <= 1e-4 * found:
                break
        return found

    @property
    def T(self) -> Operator:
        """The transpose A^T of the forward operator, as an operator of its own."""
        return _Transpose(self)

    def __matmul__(self, first: Operator) -> Operator:
        from optics.operators.combined import OperatorProduct

        return OperatorProduct(first, self)

    def __add__(self, other: Operator) -> Operator:
        from optics.operators.combined import OperatorSum

        return OperatorSum(self, other)


class _Transpose(Operator):
    """The transpose of another forward operator."""

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
    """Raise ValueError if an array's last axes don't fit a forward operator."""
    if tuple(array.shape[-len(shape) :]) != shape:
        raise ValueError(f"{name} is {tuple(array.shape)}; its last axes must be {shape}")
