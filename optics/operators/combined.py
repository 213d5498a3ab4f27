"""Products and sums of forward operators."""

from __future__ import annotations

import itertools

import torch

from optics.operators.base import Operator


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
    def bytes(self) -> int:
        """The memory in bytes of the operator in the sum that needs most."""
        return max(part.bytes for part in self.parts)
