"""Operators one after the other, and added."""

from __future__ import annotations

import itertools

import torch

from optics.operators.base import Operator


class OperatorProduct(Operator):
    """Several operators applied one after the other.

    Parameters
    ----------
    *steps : Operator
        In the order in which light meets them, at least one.

    Raises
    ------
    ValueError
        If there is none, or if one's codomain isn't the next one's domain.
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
        """The bytes that the largest step takes."""
        return max(step.bytes for step in self.steps)


class OperatorSum(Operator):
    """The sum of several operators.

    Parameters
    ----------
    *parts : Operator
        Operators of the same domain and codomain, at least one.

    Raises
    ------
    ValueError
        If there is none, or if their shapes differ.
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
        """The bytes that the largest part takes."""
        return max(part.bytes for part in self.parts)
