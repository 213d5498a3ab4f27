"""Linear operators, their products and sums, and A^T A and its inverses."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Literal

import torch

from optics.fourier import irfft2, rfft2
from optics.validation import accepts_numpy

Domain = Literal["pixels", "frequencies", "bands"]


@dataclass(frozen=True, eq=False)
class GramOperator:
    """The operator A^T A of a forward operator A, where it is diagonal or an outer product.

    Parameters
    ----------
    domain : {"pixels", "frequencies", "bands"}
        "pixels": each pixel is multiplied by its weight. "frequencies": each coefficient of the
        picture's rfft2 is multiplied by its weight. "bands": at each pixel, the bands are
        multiplied by the outer product of the pixel's weights with themselves.
    weights : torch.Tensor
        The weights: (..., rows, columns) for "pixels", (..., rows, columns // 2 + 1) for
        "frequencies", (bands, rows, columns) for "bands".
    shape : tuple of int
        The picture's (rows, columns).
    diagonal : torch.Tensor, optional
        Only for "bands", where it makes the operator an inverse: the factor of each value, from
        which the outer product is subtracted. The outer product alone if None.
    """

    domain: Domain
    weights: torch.Tensor
    shape: tuple[int, int]
    diagonal: torch.Tensor | None = None

    @property
    def largest_eigenvalue(self) -> float:
        """The largest eigenvalue of A^T A."""
        each = self.weights.square().sum(-3) if self.domain == "bands" else self.weights
        return float(each.max())

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """Apply A^T A to `x`."""
        if self.domain == "frequencies":
            return irfft2(rfft2(x) * self.weights, self.shape)
        if self.domain == "pixels":
            return x * self.weights
        product = self.weights * (self.weights * x).sum(-3, keepdim=True)
        return product if self.diagonal is None else self.diagonal * x - product

    def inverse(self, penalty: float | torch.Tensor) -> GramOperator:
        """Compute the inverse of A^T A + penalty.

        Parameters
        ----------
        penalty : float or torch.Tensor
            Positive; one number, or one for each band, pixel or frequency, of a shape that
            broadcasts to that of `weights`.

        Returns
        -------
        GramOperator
            The inverse, which needs no more memory than A^T A.

        Raises
        ------
        ValueError
            If `penalty` isn't positive everywhere.
        """
        added = torch.as_tensor(penalty, dtype=self.weights.dtype)
        least = float(added.min())
        if not least > 0:
            raise ValueError(f"penalty is {least:g}; it must be positive for an inverse to exist")
        if self.domain != "bands":
            return GramOperator(self.domain, (self.weights + added).reciprocal_(), self.shape)
        # The Sherman-Morrison formula inverts an outer product plus a diagonal matrix.
        along = self.weights / added
        along = along * (1 + (self.weights * along).sum(-3, keepdim=True)).rsqrt_()
        return GramOperator("bands", along, self.shape, added.reciprocal())

    def after_diagonal(self, domain: Domain, values: torch.Tensor) -> GramOperator | None:
        """Return the Gram operator of A D, where D is diagonal in pixels or in frequencies.

        `values` are D's diagonal. The result is None where it has no closed form.
        """
        if domain == self.domain:
            return GramOperator(domain, self.weights * squared_modulus(values), self.shape)
        if (domain, self.domain) == ("pixels", "bands"):
            return GramOperator("bands", self.weights * values, self.shape)
        return None


def squared_modulus(values: torch.Tensor) -> torch.Tensor:
    """Return the squared modulus of real or complex values."""
    if not values.is_complex():
        return values.square()
    return values.real.square().addcmul_(values.imag, values.imag)


Shape = tuple[int, ...]


class Operator(ABC):
    """Base class of a linear map A between real arrays.

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
        """The memory in bytes that one call needs besides input and output."""

    @property
    def diagonal(self) -> tuple[Domain, torch.Tensor] | None:
        """The domain and the factors if A only multiplies pixels or frequencies, else None."""
        return None

    @property
    def gram(self) -> GramOperator | None:
        """A^T A if it has a simple closed form, else None: see GramOperator."""
        if self.diagonal is None:
            return None
        domain, values = self.diagonal
        shape = int(self.domain[-2]), int(self.domain[-1])
        return GramOperator(domain, squared_modulus(values), shape)

    def gram_with(self, then: GramOperator) -> GramOperator | None:
        """Return A^T (B^T B) A if it has a closed form, for `then` = B^T B, else None."""
        return None if self.diagonal is None else then.after_diagonal(*self.diagonal)

    @accepts_numpy
    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """Apply A to `x`."""
        _require_shape("x", x, self.domain)
        return self._forward(x)

    @accepts_numpy
    def adjoint(self, y: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint A^T to `y`, defined by <A x, y> = <x, A^T y>."""
        _require_shape("y", y, self.codomain)
        return self._adjoint(y)

    def norm(self) -> float:
        """Compute the largest ``|A x|`` over all x of norm 1.

        It is exact where A^T A is known as a GramOperator. Otherwise a power iteration approaches
        the norm from below.
        """
        gram = self.gram
        return math.sqrt(gram.largest_eigenvalue) if gram else self._norm_by_power()

    def _norm_by_power(self) -> float:
        """Approximate the norm from below by at most 100 steps of power iteration."""
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
        """The transpose A^T as an operator of its own."""
        return _Transpose(self)

    def __matmul__(self, first: Operator) -> Operator:
        return OperatorProduct(first, self)

    def __add__(self, other: Operator) -> Operator:
        return OperatorSum(self, other)


class _Transpose(Operator):
    """The transpose of another operator."""

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
    """Raise ValueError if an array's last axes haven't a shape."""
    if tuple(array.shape[-len(shape) :]) != shape:
        raise ValueError(f"{name} is {tuple(array.shape)}; its last axes must be {shape}")


class OperatorProduct(Operator):
    """Several operators, applied one after the other.

    Parameters
    ----------
    *steps : Operator
        One or more operators, in the order in which they are applied.

    Raises
    ------
    ValueError
        If no operator is given, or if the codomain of one isn't the domain of the next.
    """

    def __init__(self, *steps: Operator) -> None:
        if not steps:
            raise ValueError("steps is empty; give one operator at least")
        for first, then in itertools.pairwise(steps):
            if first.codomain != then.domain:
                raise ValueError(
                    f"steps don't fit: {type(first).__name__} gives {first.codomain}, "
                    f"{type(then).__name__} takes {then.domain}"
                )
        self.steps = steps
        self.domain, self.codomain = steps[0].domain, steps[-1].codomain

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        for step in self.steps:
            x = step._forward(x)
        return x

    def _adjoint(self, y: torch.Tensor) -> torch.Tensor:
        for step in reversed(self.steps):
            y = step._adjoint(y)
        return y

    @property
    def diagonal(self) -> tuple[Domain, torch.Tensor] | None:
        """The product of all factors, if all act on pixels, or all on frequencies."""
        return _common_diagonal(self.steps, torch.mul)

    @property
    def gram(self) -> GramOperator | None:
        """A^T A of the product where it has a closed form, else None."""
        *first, last = self.steps
        found = last.gram
        for step in reversed(first):
            found = None if found is None else step.gram_with(found)
        return found

    @property
    def bytes(self) -> int:
        """The memory in bytes of the step that needs most."""
        return max(step.bytes for step in self.steps)


class OperatorSum(Operator):
    """The sum of several operators.

    Parameters
    ----------
    *parts : Operator
        One or more operators with the same domain and codomain.

    Raises
    ------
    ValueError
        If no operator is given, or if their shapes differ.
    """

    def __init__(self, *parts: Operator) -> None:
        if not parts:
            raise ValueError("parts is empty; give one operator at least")
        shapes = {(part.domain, part.codomain) for part in parts}
        if len(shapes) > 1:
            raise ValueError(f"parts differ in shape: {sorted(shapes)}; they must be alike")
        self.parts = parts
        self.domain, self.codomain = parts[0].domain, parts[0].codomain

    def _forward(self, x: torch.Tensor) -> torch.Tensor:
        return sum((part._forward(x) for part in self.parts[1:]), self.parts[0]._forward(x))

    def _adjoint(self, y: torch.Tensor) -> torch.Tensor:
        return sum((part._adjoint(y) for part in self.parts[1:]), self.parts[0]._adjoint(y))

    @property
    def diagonal(self) -> tuple[Domain, torch.Tensor] | None:
        """The sum of all factors, if all act on pixels, or all on frequencies."""
        return _common_diagonal(self.parts, torch.add)

    @property
    def bytes(self) -> int:
        """The memory in bytes of the part that needs most."""
        return max(part.bytes for part in self.parts)


def _common_diagonal(
    operators: Sequence[Operator], combine: Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
) -> tuple[Domain, torch.Tensor] | None:
    """Combine the factors of operators that are diagonal in the same domain; None for others."""
    each = [one.diagonal for one in operators]
    known = [one for one in each if one is not None]
    if len(known) < len(each) or len({domain for domain, _ in known}) > 1:
        return None
    return known[0][0], reduce(combine, [values for _, values in known])
