"""Products and sums of forward operators."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import reduce

import torch

from optics.operators.base import Operator
from optics.operators.gram import Domain, GramOperator


class OperatorProduct(Operator):
    """The product of several forward operators, which are applied one after the other.

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
        """The product of the operators' factors, if all act on pixels, or all on frequencies."""
        return _common_diagonal(self.steps, torch.mul)

    @property
    def gram(self) -> GramOperator | None:
        """The operator product's A^T A where it has a closed form, else None."""
        *first, last = self.steps
        found = last.gram
        for step in reversed(first):
            found = None if found is None else step.gram_with(found)
        return found

    @property
    def bytes(self) -> int:
        """The memory in bytes of the operator in the product that needs most."""
        return max(step.bytes for step in self.steps)


class OperatorSum(Operator):
    """The sum of several forward operators.

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
        """The sum of the operators' factors, if all act on pixels, or all on frequencies."""
        return _common_diagonal(self.parts, torch.add)

    @property
    def bytes(self) -> int:
        """The memory in bytes of the operator in the sum that needs most."""
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
