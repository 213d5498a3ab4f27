"""Conjugate gradients, for whatever inner product the unknowns have."""

from __future__ import annotations

from collections.abc import Callable

import torch

InnerProduct = Callable[[torch.Tensor, torch.Tensor], float]


def conjugate_gradients(
    normal: Callable[[torch.Tensor], torch.Tensor],
    residual: torch.Tensor,
    start: torch.Tensor,
    preconditioner: torch.Tensor,
    inner_product: InnerProduct,
    tolerance: float,
    steps: int,
) -> tuple[torch.Tensor, int]:
    """The x with normal(x) = right-hand side, and how many steps it took from `start`.

    By Hestenes and Stiefel (1952, doi 10.6028/jres.049.044). residual: the right-hand side less
    normal(start); it is written over. preconditioner: about that of `normal`, for each unknown.
    inner_product: the product of two such x. tolerance: of what is left with what it is turned
    into, below which it ends; after so many steps it ends as well.
    """
    turned = residual * preconditioner
    way, length = turned.clone(), inner_product(residual, turned)
    x, taken = start, 0
    while taken < steps and length > tolerance:
        bent = normal(way)
        far = length / inner_product(way, bent)
        x = x.add(way, alpha=far)
        residual = residual.sub_(bent, alpha=far)
        turned = residual * preconditioner
        before, length = length, inner_product(residual, turned)
        way = way.mul_(length / before).add_(turned)
        taken += 1
    return x, taken
