"""Preconditioned conjugate gradients for a given inner product of the unknowns."""

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
) -> tuple[torch.Tensor, int, float]:
    """Solve a deconvolution's linear system normal(x) = b by preconditioned conjugate gradients.

    The method is that of Hestenes and Stiefel (1952, doi 10.6028/jres.049.044).

    Parameters
    ----------
    normal : callable
        Applies the symmetric positive definite matrix to an x.
    residual : torch.Tensor
        b less normal(start); it is overwritten.
    start : torch.Tensor
        First estimate of x.
    preconditioner : torch.Tensor
        Approximate inverse of `normal`, one factor for each unknown.
    inner_product : callable
        Inner product of two such x.
    tolerance : float
        The solver ends when the inner product of the residual and the preconditioned residual is
        at most this.
    steps : int
        Largest number of steps.

    Returns
    -------
    tuple of torch.Tensor, int and float
        x, the number of steps done, and the inner product that is left.
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
    return x, taken, length
