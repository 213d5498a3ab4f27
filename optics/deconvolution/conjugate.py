"""Conjugate gradients, for whatever inner product the unknowns have."""

from __future__ import annotations

from collections.abc import Callable

import torch

Inner = Callable[[torch.Tensor, torch.Tensor], float]


def conjugate_gradients(
    normal: Callable[[torch.Tensor], torch.Tensor],
    left: torch.Tensor,
    start: torch.Tensor,
    inverse: torch.Tensor,
    inner: Inner,
    enough: float,
    steps: int,
) -> tuple[torch.Tensor, int]:
    """The x with normal(x) = wanted, and how many steps it took from `start` (Hestenes and Stiefel
    1952, doi 10.6028/jres.049.044).

    left: wanted less normal(start); it is written over. inverse: about that of `normal`, for each
    unknown. inner: the product of two such x. enough: of what is left with what it is turned into,
    below which it ends; after so many steps it ends as well.
    """
    turned = left * inverse
    way, length = turned.clone(), inner(left, turned)
    x, taken = start, 0
    while taken < steps and length > enough:
        bent = normal(way)
        far = length / inner(way, bent)
        x = x.add(way, alpha=far)
        left = left.sub_(bent, alpha=far)
        turned = left * inverse
        before, length = length, inner(left, turned)
        way = way.mul_(length / before).add_(turned)
        taken += 1
    return x, taken
