"""Deblur with the Poisson likelihood of counted photons and total variation."""

from __future__ import annotations

import torch

from optics.inverse.frequency_step import DataProx
from optics.inverse.method import SETUP_COST, Gain, RestorationCost, RestorationMethod
from optics.inverse.observation import Observation
from optics.inverse.own_terms import in_own_unit
from optics.inverse.restored_image import RestoredImage
from optics.inverse.total_variation import total_variation
from optics.progress import Progress
from optics.threads import single_threaded


@single_threaded
@torch.no_grad()
@in_own_unit(weight=1, centred=True)
def poisson_total_variation(
    observation: Observation,
    weight: float | None = None,
    *,
    iterations: int = 30,
    tol: float = 0.0,
    positive: bool = False,
    progress: Progress | None = None,
) -> RestoredImage:
    """Deblur with a Poisson likelihood and a total-variation prior.

    The result x minimises m * the sum of (H x - y log H x) + weight * the sum of |∇x|. The first
    sum is over trusted pixels y, and m is their mean: the likelihood of counting y photons where v
    are expected is proportional to exp(y log v - v) (thesis Eq. 2.30). Negative light, which the
    subtraction of dark frames leaves, counts as 0. Near v = y the data term is m / y * (v - y)² /
    2: a dim pixel, which has less noise, counts more, and one of mean brightness as much as in
    total_variation(), so that `weight` has the same meaning.

    The problem is convex (Figueiredo and Bioucas-Dias 2010, doi 10.1109/TIP.2010.2053941; Chambolle
    and Pock 2011, doi 10.1007/s10851-010-0251-1), with v = H x split off.

    Raises ValueError for a weight that isn't positive, or no iteration.

    weight: regularisation weight, in light per pixel. Estimated from the evidence of the picture if
        None.
    iterations: largest number of iterations.
    tol: relative change of the picture at which the iteration ends; 0 for all iterations.
    positive: whether x is kept from being negative in each iteration. Photographs of few photons
        and of stars on a dark sky need this, and more iterations.
    """
    return total_variation(
        observation, weight, iterations=iterations, tol=tol, positive=positive,
        data_prox=poisson_data_prox(observation), progress=progress,
    )  # fmt: skip


def poisson_data_prox(observation: Observation) -> DataProx:
    """Build the proximal step of the Poisson data term.

    The step returns the light v that minimises m t (v - y log v) + coupling / 2 * (v - light)²,
    where t is a pixel's weight. There the derivative m t (1 - y / v) + coupling * (v - light) is 0,
    so that v is the non-negative root of v² - (light - p) v - p y with p = m t / coupling.
    """
    data = observation.normalised_image.clamp(min=0)
    trust = (
        torch.ones_like(data)
        if observation.effective_weights is None
        else observation.effective_weights
    )
    share = trust * ((data * trust).sum() / trust.sum())
    # The square roots are taken first, since the product of two small numbers may underflow to 0.
    product = share.sqrt() * data.sqrt()

    def fit(light: torch.Tensor, coupling: float) -> torch.Tensor:
        half = (light - share / coupling) / 2
        middle = product / coupling**0.5
        root = torch.hypot(half, middle).add_(half.abs())
        # The other root follows from the product of both, which avoids cancellation.
        other = middle / root.clamp(min=torch.finfo(root.dtype).tiny) * middle
        return torch.where(half > 0, root, other)

    return fit


METHOD = RestorationMethod(
    "likeliest under photon noise, few edges",
    poisson_total_variation, {
        12: Gain(7.97, -0.89, 1.10, 1.07, 0.37, -0.86),
        20: Gain(8.27, -1.03, 1.23, 1.17, 0.38, -0.75),
        30: Gain(8.36, -1.10, 1.31, 1.23, 0.36, -0.69),
    }, 30, SETUP_COST,
    lambda _: RestorationCost(4, 75),
)  # fmt: skip
