"""Give linear maps derivatives of any order, in what they map and in numbers that shape them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch

from optics.validation import records_gradient

Apply = Callable[[torch.Tensor], torch.Tensor]


def apply_function(function: Any, *arguments: Any) -> Any:
    """Call a torch autograd function, whose `apply` has no type annotations."""
    return function.apply(*arguments)


def differentiate_once(
    what: str, derivative: torch.Tensor, inputs: Sequence[torch.Tensor]
) -> torch.Tensor:
    """Return a derivative that itself has none; whoever asks for a second one is told so.

    what: is differentiated, as the error names it.
    inputs: all that the derivative depends on.

    torch's own `once_differentiable` tells it only of a gradient that needs derivatives itself, and
    else takes the derivative to be constant.
    """
    if not torch.is_grad_enabled():
        return derivative
    return apply_function(_DifferentiatedOnce, what, derivative.detach(), *inputs)


class _DifferentiatedOnce(torch.autograd.Function):
    """Passes a derivative on; it can't be differentiated."""

    @staticmethod
    def forward(ctx: Any, what: str, derivative: torch.Tensor, *inputs: torch.Tensor) -> Any:
        ctx.what = what
        return derivative.view_as(derivative)

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> Any:
        raise NotImplementedError(
            f"{ctx.what} can be differentiated once; take differences of its first derivatives"
        )


Weight = torch.Tensor | float
"""Factor on samples, which broadcasts against them."""

Term = tuple[Weight, "ShapedMap", Weight]
"""A linear map with factors after it and before it."""

Derivatives = Sequence[Sequence[Term]]
"""For each number that shapes a map, the map's derivative in it, a sum of terms."""


@dataclass(frozen=True, eq=False)
class ShapedMap:
    """A linear map whose kernel depends on numbers, such as a shift.

    forward, adjoint: the map and its conjugate transpose at the numbers' present values, without
        derivatives.
    derive: returns the derivatives of this map in the numbers. Their terms hold maps that depend on
        the same numbers, so that derivatives of any order follow.
    """

    forward: Apply
    adjoint: Apply
    derive: Callable[[ShapedMap], Derivatives]

    def transposed(self) -> ShapedMap:
        """Return the conjugate transpose, which depends on the same numbers."""

        def derive(_: ShapedMap) -> Derivatives:
            return [
                [
                    (_conjugate(before), inner.transposed(), _conjugate(after))
                    for after, inner, before in terms
                ]
                for terms in self.derive(self)
            ]

        return ShapedMap(self.adjoint, self.forward, derive)

    def __call__(self, field: torch.Tensor, numbers: Sequence[torch.Tensor]) -> torch.Tensor:
        """Apply the map to a field; differentiable in the field and in the numbers.

        numbers: 0-d tensors of the values for which the map was made.
        """
        if not records_gradient(field, *numbers):
            return self.forward(field.detach())
        return apply_function(_Shaped, self, field, *numbers)


def apply_linear_map(forward: Apply, adjoint: Apply, field: torch.Tensor) -> torch.Tensor:
    """Apply a linear map with its adjoint as the derivative.

    It is differentiable to any order; neither function needs derivatives of its own.
    """
    if not records_gradient(field):
        return forward(field.detach())
    return ShapedMap(forward, adjoint, lambda _: ())(field, ())


class _Shaped(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, shaped: ShapedMap, field: torch.Tensor, *numbers: torch.Tensor
    ) -> torch.Tensor:
        ctx.map, ctx.dtype = shaped, field.dtype
        # The field is needed for derivatives in the numbers only.
        kept = field if any(ctx.needs_input_grad[2:]) else None
        ctx.save_for_backward(kept, *numbers)
        return shaped.forward(field)

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        field, *numbers = ctx.saved_tensors
        shaped: ShapedMap = ctx.map
        answers: list[torch.Tensor | None] = [None] * (1 + len(numbers))
        if ctx.needs_input_grad[1]:
            answers[0] = shaped.transposed()(gradient, numbers).to(ctx.dtype)
        if any(ctx.needs_input_grad[2:]):
            answers[1:] = _number_gradients(shaped, field, numbers, gradient)
        return (None, *answers)


def _number_gradients(
    shaped: ShapedMap,
    field: torch.Tensor,
    numbers: Sequence[torch.Tensor],
    gradient: torch.Tensor,
) -> list[torch.Tensor]:
    """Return the derivatives in each of the numbers, weighted by a gradient.

    Terms that begin alike share the map.
    """
    products: dict[tuple[int, int], torch.Tensor] = {}

    def product(inner: ShapedMap, before: Weight) -> torch.Tensor:
        key = (id(inner), id(before))
        if key not in products:
            mapped = inner((field * _to_device_of(field, before)).to(field.dtype), numbers)
            # Sums of many samples are kept in double precision.
            whole = gradient.to(torch.complex128).conj() * mapped
            products[key] = whole.flatten(0, -3).sum(0) if whole.ndim > 2 else whole
        return products[key]

    def derivative(terms: Sequence[Term]) -> torch.Tensor:
        parts = (
            (product(inner, before) * _to_device_of(field, after)).sum()
            for after, inner, before in terms
        )
        return torch.stack(list(parts)).sum().real

    derivatives = shaped.derive(shaped)
    return [derivative(terms).to(one) for one, terms in zip(numbers, derivatives, strict=True)]


def _to_device_of(field: torch.Tensor, weight: Weight) -> Weight:
    return weight.to(field.device) if isinstance(weight, torch.Tensor) else weight


def _conjugate(weight: Weight) -> Weight:
    return weight.conj() if isinstance(weight, torch.Tensor) else weight
