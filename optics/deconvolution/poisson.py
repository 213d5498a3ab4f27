"""Deconvolution of counted photons that keeps edges: Poisson's likelihood and total variation."""

from __future__ import annotations

from typing import Any

import torch

from optics.deconvolution.method import SETUP_COST, RestorationCost, RestorationMethod
from optics.deconvolution.observation import Observation
from optics.deconvolution.restored_image import RestoredImage
from optics.deconvolution.splitting import DataProx
from optics.deconvolution.total_variation import total_variation
from optics.progress import Progress
from optics.threads import single_threaded


@single_threaded
@torch.no_grad()
def poisson_total_variation(
    observation: Observation,
    weight: float | None = None,
    *,
    iterations: int = 30,
    tol: float = 0.0,
    positive: bool = False,
    progress: Progress | None = None,
) -> RestoredImage:
    """The picture x with the least m * sum of (H x - y log H x) + weight * sum of |∇x|, trusted
    pixels y alone, m their mean: photons' likelihood, where total_variation() has squares.

    Photons counted as y where v are expected are as likely as exp(y log v - v) (thesis Eq. 2.30);
    negative light, which dark subtraction leaves, counts as none. Near v = y the misfit is
    m / y * (v - y)² / 2: a dim pixel, which has less noise, counts for more, and one of mean
    brightness for as much as in least squares, so that `weight` means the same and is found the
    same way. The problem is convex (Figueiredo and Bioucas-Dias 2010, doi 10.1109/TIP.2010.2053941;
    Chambolle and Pock 2011, doi 10.1007/s10851-010-0251-1, solve it too); it is split as in
    Splitting, with v = H x held to what the scene sends, and v's step is a quadratic's root.

    weight: light per pixel, by the evidence of the picture if None. iterations: at most; ends when
    the picture's relative change is tol. positive: whether x may be negative nowhere while it is
    looked for, which single photons and stars on darkness need, and more iterations; H x never is,
    and the answer is cut at 0.
    Raises ValueError for a weight that isn't positive, or no iteration.
    """
    how: dict[str, Any] = {"iterations": iterations, "tol": tol, "positive": positive}
    return total_variation(
        observation, weight, data_prox=poisson_data_prox(observation), progress=progress, **how
    )


def poisson_data_prox(observation: Observation) -> DataProx:
    """The light v with the least m t (v - y log v) + coupling / 2 * (v - light)², t the trust.

    Where its slope m t (1 - y / v) + coupling * (v - light) is 0: the root of
    v² - (light - p) v - p y that isn't negative, with p = m t / coupling.
    """
    data = observation.normalised_image.clamp(min=0)
    trust = (
        torch.ones_like(data)
        if observation.effective_weights is None
        else observation.effective_weights
    )
    share = trust * ((data * trust).sum() / trust.sum())
    # Roots apart: the product of two small numbers may be none.
    product = share.sqrt() * data.sqrt()

    def fit(light: torch.Tensor, coupling: float) -> torch.Tensor:
        half = (light - share / coupling) / 2
        middle = product / coupling**0.5
        root = torch.hypot(half, middle).add_(half.abs())
        # Of the two roots' product, so that no digits cancel.
        other = middle / root.clamp(min=torch.finfo(root.dtype).tiny) * middle
        return torch.where(half > 0, root, other)

    return fit


METHOD = RestorationMethod(
    "likeliest under photon noise, few edges",
    poisson_total_variation, {8: 3.8, 20: 3.9, 30: 4.0}, 30, SETUP_COST,
    lambda _: RestorationCost(4, 75),
)  # fmt: skip
