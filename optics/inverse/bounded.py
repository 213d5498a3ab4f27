"""Deblur within bounds of the light, for any forward operator (thesis Eq. 2.27 and 2.32)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import Bounds, OptimizeResult, minimize

from optics.inverse.blur import blur_operator
from optics.inverse.method import SETUP_COST, Gain, RestorationCost, RestorationMethod
from optics.inverse.observation import Observation, require_weights
from optics.inverse.operator import Operator
from optics.inverse.own_terms import in_own_unit
from optics.inverse.restored_image import RestoredImage
from optics.inverse.total_variation import total_variation
from optics.inverse.wiener import wiener
from optics.plane import centred_pad
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import (
    accepts_numpy,
    require_count,
    require_finite,
    require_positive,
    require_same_shape,
)

SmoothPrior = Literal["total variation", "gradient", "tikhonov"]

SMOOTH_PRIORS: tuple[SmoothPrior, ...] = ("total variation", "gradient", "tikhonov")

ValueAndGradient = tuple[torch.Tensor, torch.Tensor]
"""The value of an objective, and its gradient."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """Half the weighted sum of (A x - y)², the data term.

    A clipped pixel counts only where A x is below y, since its light is at least y. `pixel_weights`
    are 1 everywhere if None.
    """

    operator: Operator
    data: torch.Tensor
    pixel_weights: torch.Tensor | None = None
    clipped: torch.Tensor | None = None

    def __call__(self, x: torch.Tensor) -> ValueAndGradient:
        left = self.operator(x).sub_(self.data)
        if self.clipped is not None:
            left = torch.where(self.clipped, left.clamp(max=0), left)
        pull = left if self.pixel_weights is None else left * self.pixel_weights
        return (left * pull).sum() / 2, self.operator.adjoint(pull)


@dataclass(frozen=True, eq=False)
class Smoothness:
    """The penalty of each band of a picture, with its gradient.

    "tikhonov" is half the sum of x², and "gradient" is half the sum of |∇x|². "total variation" is
    the sum of √(|∇x|² + smoothing²) - smoothing, which is below the sum of |∇x| by at most
    `smoothing` per pixel. `periodic` says whether a picture's opposite edges are neighbours.
    Pictures are (..., rows, columns).
    """

    prior: SmoothPrior
    smoothing: float
    periodic: bool

    def __call__(self, x: torch.Tensor) -> ValueAndGradient:
        if self.prior == "tikhonov":
            return x.square().sum() / 2, x
        down, along = differences(x, self.periodic)
        squares = down.square() + along.square()
        if self.prior == "gradient":
            return squares.sum() / 2, differences_adjoint(down, along)
        length = squares.add_(self.smoothing**2).sqrt_()
        value = (length - self.smoothing).sum()
        return value, differences_adjoint(down / length, along / length)


def differences(x: torch.Tensor, periodic: bool) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute the forward differences down the columns and along the rows.

    In the last row and column they are 0, or for a periodic picture the differences to the first
    row and column.
    """
    down, along = x.roll(-1, -2).sub_(x), x.roll(-1, -1).sub_(x)
    if not periodic:
        down[..., -1, :] = 0
        along[..., -1] = 0
    return down, along


def differences_adjoint(down: torch.Tensor, along: torch.Tensor) -> torch.Tensor:
    """Apply the adjoint of differences()."""
    return down.roll(1, -2).sub_(down).add_(along.roll(1, -1)).sub_(along)


# Default smoothing of total variation, relative to the light's scale: it counts gradients that
# are shorter about by their squares.
_SMOOTHING = 1e-2

Array = NDArray[np.float64]


class Minimum(NamedTuple):
    """The minimum of an objective within bounds, and the value of the objective there.

    value: the minimiser, in the operator's domain.
    projected_gradient: largest entry of the projected gradient there, on the light's scale.
    iterations: number of iterations done.
    converged: whether `projected_gradient` is at most the tolerance.
    """

    value: torch.Tensor
    objective: float
    projected_gradient: float
    iterations: int
    converged: bool


@single_threaded
@accepts_numpy
@torch.no_grad()
def minimise_within_bounds(
    operator: Operator,
    data: torch.Tensor,
    weight: float,
    prior: SmoothPrior = "total variation",
    *,
    smoothing: float | None = None,
    lower: float | torch.Tensor = 0.0,
    upper: float | torch.Tensor = math.inf,
    weights: torch.Tensor | None = None,
    clipped: torch.Tensor | None = None,
    start: torch.Tensor | None = None,
    periodic: bool = False,
    iterations: int = 300,
    tol: float = 1e-4,
    progress: Progress | None = None,
) -> Minimum:
    """Minimise ``|A x - y|² / 2 + weight * prior(x)`` for x within bounds.

    The minimiser is L-BFGS-B (Byrd et al. 1995, doi 10.1137/0916069; thesis Eq. 2.32), in double
    precision. Raises ValueError if an argument has the wrong shape or isn't finite, or if the
    bounds cross.

    operator: A, from pictures (..., rows, columns) to data.
    data: y, of the operator's codomain.
    weight: regularisation weight, 0 or more.
    prior: the penalty: see Smoothness.
    smoothing: see restore_within_bounds(). It raises the least objective of exact total variation
        by at most weight * smoothing * pixels.
    lower, upper: bounds of all samples, or of each sample.
    weights: weight of each datum, 0 where it isn't used. All 1 if None.
    clipped: True where the light is at least what was measured.
    start: picture from which the minimisation starts.
    periodic: whether opposite edges of the picture are neighbours.
    tol: largest entry of the projected gradient, on the light's scale, at which the search ends.
    """
    progress = progress or Progress()
    _require(operator, data, weight, prior, iterations, tol)
    y = data.to(torch.float64)
    even = float(operator(torch.ones(operator.domain, dtype=torch.float64)).mean())
    gain = abs(even) or operator.norm()
    if not gain > 0:
        raise ValueError("operator lets nothing through; there is nothing to be restored")
    light = max(float(y.std(correction=0)), 1e-3 * float(y.abs().mean())) / gain or 1.0
    length = _SMOOTHING * light if smoothing is None else float(smoothing)
    require_positive("smoothing", length, "")
    require_same_shape("data", y, weights=weights, clipped=clipped)
    if weights is not None:
        require_weights(weights)
        weights = weights.to(torch.float64)
    clipped = None if clipped is None else clipped.to(torch.bool)
    misfit, smooth = Misfit(operator, y, weights, clipped), Smoothness(prior, length, periodic)
    low, high = (
        torch.as_tensor(one, dtype=torch.float64).broadcast_to(operator.domain)
        for one in (lower, upper)
    )
    if not bool((low <= high).all()):
        bad = int((~(low <= high)).sum())
        raise ValueError(f"lower is above upper, or NaN, at {bad} samples; bounds mustn't cross")
    unit = light * gain**2

    def evaluate(z: Array) -> tuple[float, Array]:
        progress.raise_if_cancelled()
        x = torch.from_numpy(z).reshape(operator.domain) * light
        (value, slope), (more, steeper) = misfit(x), smooth(x)
        gradient = (slope + weight * steeper) / unit
        return float(value + weight * more) / (unit * light), gradient.flatten().numpy()

    done = itertools.count(1)

    def tell(intermediate_result: OptimizeResult) -> None:
        number = next(done)
        progress.report(number / iterations, f"L-BFGS-B {number}/{iterations}")

    first = operator.adjoint(y) / gain**2 if start is None else start.to(torch.float64)
    if first.shape != operator.domain:
        raise ValueError(f"start is {tuple(first.shape)}; it must be {operator.domain}")
    require_finite("start", first)
    within = Bounds((low / light).flatten().numpy(), (high / light).flatten().numpy())
    # `maxcor` is the number of steps that L-BFGS-B remembers; `maxls` limits its line search.
    found = minimize(
        evaluate,
        (torch.clamp(first, low, high) / light).flatten().numpy(),
        method="L-BFGS-B",
        jac=True,
        bounds=within,
        callback=tell,
        options={"maxiter": iterations, "maxfun": 20 * iterations, "maxcor": 10,
                 "ftol": 0.0, "gtol": tol, "maxls": 40},
    )  # fmt: skip
    value, gradient = evaluate(found.x)
    left = float(np.abs(np.clip(found.x - gradient, within.lb, within.ub) - found.x).max())
    x = torch.from_numpy(found.x).reshape(operator.domain) * light
    # The change of units may round a value past its bound.
    x = torch.clamp(x, low, high)
    return Minimum(x, value * unit * light, left, int(found.nit), left <= tol)


@in_own_unit(
    bounds=("lower", "upper"),
    weight=lambda given: float(given["prior"] == "total variation"),
    smoothing=1,
    centred=True,
)
def restore_within_bounds(
    observation: Observation,
    weight: float | None = None,
    prior: SmoothPrior = "total variation",
    *,
    smoothing: float | None = None,
    lower: float | torch.Tensor = 0.0,
    upper: float | torch.Tensor = math.inf,
    iterations: int = 200,
    tol: float = 1e-3,
    progress: Progress | None = None,
) -> RestoredImage:
    """Undo a photograph's blur so that no pixel lies below or above given bounds.

    See `optics.inverse.bounded.minimise_within_bounds`. With an unknown border, the scene around
    the frame is estimated too, within the same bounds.

    Parameters
    ----------
    observation : Observation
        Photograph and PSF.
    weight : float, optional
        Regularisation weight, 0 or more; total_variation() or wiener() estimates it if None.
    prior : {"total variation", "gradient", "tikhonov"}, default "total variation"
        The penalty: the lengths of gradients, their squares, or the squares of the light.
    smoothing : float, optional
        Length of a gradient, in light per pixel, below which total variation is smooth. A hundredth
        of the light's scale if None; smaller values need more iterations.
    lower, upper : float or torch.Tensor, (rows, columns), optional
        Bounds of each pixel of the frame, by default 0 and infinity. Beyond it, the smallest value
        of `lower` and the largest of `upper` hold.
    iterations : int, default 200
        Largest number of iterations.
    tol : float, default 1e-3
        Largest entry of the projected gradient, on the light's scale, at which the search ends.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    RestoredImage
        The picture in the photograph's frame, within the bounds.

    Raises
    ------
    ValueError
        If an argument has the wrong shape or isn't finite, or if the bounds cross.

    References
    ----------
    Thesis Eq. 2.27 and 2.32; Byrd et al. 1995, doi 10.1137/0916069.
    """
    if prior not in SMOOTH_PRIORS:
        raise ValueError(f"prior is {prior!r}; take one of {', '.join(SMOOTH_PRIORS)}")
    progress = progress or Progress()
    used = weight
    if used is None and prior == "total variation":
        used = total_variation(observation, iterations=15).weight or 0.0
    elif used is None:
        flat = prior == "tikhonov"
        used = wiener(observation, None, "flat" if flat else "gradient", steps=0).weight or 0.0
        # The weight of wiener() is for frequencies in cycles per pixel, not in radians.
        used = used if flat else used / (2 * math.pi) ** 2
    frame = observation.image.shape
    operator = blur_operator(
        observation.psf.to(torch.float64) / observation.psf_sum, frame, observation.border
    )
    inside = observation.border == "dark"
    found = minimise_within_bounds(
        operator,
        observation.normalised_image,
        used,
        prior,
        smoothing=_SMOOTHING * observation.scale if smoothing is None else smoothing,
        lower=lower if inside else _extend_bound(lower, observation, "lower"),
        upper=upper if inside else _extend_bound(upper, observation, "upper"),
        weights=observation.weights,
        clipped=observation.clipped,
        start=observation.inpainted_image if inside else observation.extended_image,
        periodic=not inside,
        iterations=iterations,
        tol=tol,
        progress=progress,
    )
    spread = operator(found.value)
    squares, trust = (spread - observation.normalised_image).square(), observation.effective_weights
    if trust is not None:
        squares = squares * trust * trust.numel() / (trust > 0).sum()
    whole = centred_pad(found.value, observation.period_shape) if inside else found.value
    return RestoredImage(
        observation.crop_to_picture(whole).to(observation.image.dtype),
        f"L-BFGS-B, {prior}",
        observation.noise,
        math.sqrt(float(squares.mean())) / observation.scene_noise,
        used,
        found.iterations,
        [],
        found.converged,
        whole.to(observation.image.dtype),
    )


def _require(
    operator: Operator, data: torch.Tensor, weight: float, prior: str, iterations: int, tol: float
) -> None:
    """Raise ValueError for arguments that can't be used."""
    if prior not in SMOOTH_PRIORS:
        raise ValueError(f"prior is {prior!r}; take one of {', '.join(SMOOTH_PRIORS)}")
    if not (weight >= 0 and math.isfinite(weight)):
        raise ValueError(f"weight is {weight:g}; give 0 or more")
    require_count("iterations", iterations)
    require_positive("tol", tol, "")
    if tuple(data.shape) != operator.codomain:
        raise ValueError(f"data are {tuple(data.shape)}; the operator gives {operator.codomain}")
    require_finite("data", data)


def _extend_bound(
    bound: float | torch.Tensor, observation: Observation, name: str
) -> float | torch.Tensor:
    """Extend a bound from the frame to the whole period, by its smallest or largest value."""
    given = torch.as_tensor(bound, dtype=torch.float64)
    if not given.ndim:
        return bound
    if given.shape != observation.image.shape:
        raise ValueError(
            f"{name} is {tuple(given.shape)} and image {tuple(observation.image.shape)}; give "
            "a number, or one for each pixel"
        )
    beyond = float(given.min() if name == "lower" else given.max())
    whole = torch.full(observation.period_shape, beyond, dtype=torch.float64)
    observation.crop_to_frame(whole).copy_(given)
    return whole


# In 30 cases it gained 0.6 and 0.4 dB less than total variation of 30 and 60 iterations.
METHOD = RestorationMethod(
    "few edges, light never negative, by a general minimiser (Eq. 2.32)",
    restore_within_bounds, {
        50: Gain(7.96, -1.03, 1.29, 1.26, 0.40, -0.74),
        100: Gain(8.11, -1.10, 1.32, 1.35, 0.33, -0.64),
    }, 100, SETUP_COST, lambda _: RestorationCost(8, 300),
)  # fmt: skip
