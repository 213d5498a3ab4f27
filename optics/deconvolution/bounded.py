"""Restoration within bounds, through any forward operator (thesis Eq. 2.27 and 2.32)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import Bounds, OptimizeResult, minimize

from optics.deconvolution.method import SETUP_COST, RestorationCost, RestorationMethod
from optics.deconvolution.objectives import SMOOTH_PRIORS, Misfit, Smoothness, SmoothPrior
from optics.deconvolution.observation import Observation, require_weights
from optics.deconvolution.restored_image import RestoredImage
from optics.deconvolution.total_variation import total_variation
from optics.deconvolution.wiener import wiener
from optics.operators.base import Operator
from optics.operators.blur import blur_operator
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import (
    accepts_numpy,
    require_count,
    require_finite,
    require_positive,
    require_same_shape,
)

_SMOOTHING = 1e-2
"""Of the light's scale: lengths of gradients below it count by their squares."""

_MEMORY = 10
"""Steps that the quasi-Newton method remembers."""

_LINE_SEARCH_TRIALS = 40
"""Trials in one step, at most."""

_WEIGHT_ITERATIONS = 15
"""Iterations of total variation that tell its weight."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where an objective is least within bounds.

    value: of the operator's domain. objective: there, without the data's own constant.
    projected_gradient: of the projected gradient the largest entry, on the light's scale, at which
    it ended. iterations: taken. converged: whether `projected_gradient` fell to what was asked.
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
    """The x, lower <= x <= upper, with the least |A x - y|² / 2 + weight * prior(x), by L-BFGS-B
    (Byrd et al. 1995, doi 10.1137/0916069; thesis Eq. 2.32), in double precision.

    operator: A, from pictures (..., rows, columns) to data. prior, periodic: see Smoothness.
    smoothing: length of a gradient, light per pixel, below which total variation is rounded; it
    raises the least objective of unrounded total variation by weight * smoothing * pixels at most.
    A hundredth of the light's scale if None; less takes more iterations. lower, upper: numbers, or
    arrays for each sample. weights: trust of each datum, 0 where it's dead. clipped: True where
    the light is at least what was measured. iterations: at most; it ends where no entry of the
    projected gradient is above tol, both on the light's scale.
    Raises ValueError for what doesn't fit, isn't finite, or bounds that cross.
    """
    progress = progress or Progress()
    _require(operator, data, weight, prior, iterations, tol)
    y = data.to(torch.float64)
    gain = _gain(operator)
    light = max(float(y.std(correction=0)), 1e-3 * float(y.abs().mean())) / gain or 1.0
    length = _SMOOTHING * light if smoothing is None else float(smoothing)
    require_positive("smoothing", length, "")
    trust, full = _validate_weights(y, weights, clipped)
    misfit = Misfit(operator, y, trust, full)
    smooth = Smoothness(prior, length, periodic)
    low, high = _bounds(operator, lower, upper)
    unit = light * gain**2

    def evaluate(z: Array) -> tuple[float, Array]:
        progress.raise_if_cancelled()
        x = torch.from_numpy(z).reshape(operator.domain) * light
        (value, slope), (more, steeper) = misfit(x), smooth(x)
        gradient = (slope + weight * steeper) / unit
        return float(value + weight * more) / (unit * light), gradient.flatten().numpy()

    done = _ProgressCallback(progress, iterations)
    first = operator.adjoint(y) / gain**2 if start is None else start.to(torch.float64)
    if first.shape != operator.domain:
        raise ValueError(f"start is {tuple(first.shape)}; it must be {operator.domain}")
    require_finite("start", first)
    within = Bounds((low / light).flatten().numpy(), (high / light).flatten().numpy())
    found = minimize(
        evaluate,
        (torch.clamp(first, low, high) / light).flatten().numpy(),
        method="L-BFGS-B",
        jac=True,
        bounds=within,
        callback=done,
        options={"maxiter": iterations, "maxfun": 20 * iterations, "maxcor": _MEMORY,
                 "ftol": 0.0, "gtol": tol, "maxls": _LINE_SEARCH_TRIALS},
    )  # fmt: skip
    value, gradient = evaluate(found.x)
    left = float(np.abs(np.clip(found.x - gradient, within.lb, within.ub) - found.x).max())
    x = torch.from_numpy(found.x).reshape(operator.domain) * light
    # Rounding of the units may carry a value past its bound.
    x = torch.clamp(x, low, high)
    return Minimum(x, value * unit * light, left, int(found.nit), left <= tol)


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
    """Restore a photograph so that no pixel lies below or above given bounds.

    The least of |A x - y|² / 2 + weight · prior(x) within the bounds, by L-BFGS-B in double
    precision. With an unknown border the scene around the frame is estimated too, within the same
    bounds. See `optics.deconvolution.bounded.minimise_within_bounds`.

    Parameters
    ----------
    observation : Observation
        Photograph and PSF.
    weight : float, optional
        Regularisation weight, 0 or more. If None, the one that total_variation() finds, or that
        wiener() predicts for the other priors.
    prior : {"total variation", "gradient", "tikhonov"}, default "total variation"
        What is penalised: lengths of gradients, their squares, or the squares of the light.
    smoothing : float, optional
        Length of a gradient, light per pixel, below which total variation is rounded. A hundredth
        of the light's scale if None; less takes more iterations.
    lower, upper : float or torch.Tensor, (rows, columns), optional
        Bounds of each pixel of the frame, by default 0 and infinity. Beyond the frame the lowest of
        `lower` and the highest of `upper` hold.
    iterations : int, default 200
        Iterations at most.
    tol : float, default 1e-3
        Largest entry of the projected gradient, on the light's scale, at which the search ends.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    RestoredImage
        The picture in the photograph's frame, on the bounds or between them.

    Raises
    ------
    ValueError
        If an argument doesn't fit or isn't finite, or if bounds cross.

    References
    ----------
    Thesis Eq. 2.27 and 2.32; Byrd et al. 1995, doi 10.1137/0916069.
    """
    if prior not in SMOOTH_PRIORS:
        raise ValueError(f"prior is {prior!r}; take one of {', '.join(SMOOTH_PRIORS)}")
    progress = progress or Progress()
    used = _default_weight(observation, prior) if weight is None else weight
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
    image = found.value if inside else observation.crop_to_frame(found.value)
    return RestoredImage(
        image.to(observation.image.dtype),
        f"L-BFGS-B, {prior}",
        observation.noise,
        _residual(observation, spread),
        used,
        found.iterations,
        [],
        found.converged,
        found.value.to(observation.image.dtype),
    )


class _ProgressCallback:
    """Tells the progress after each iteration."""

    def __init__(self, progress: Progress, iterations: int) -> None:
        self._progress, self._iterations, self._done = progress, iterations, 0

    def __call__(self, intermediate_result: OptimizeResult) -> None:
        self._done += 1
        self._progress.report(
            self._done / self._iterations, f"L-BFGS-B {self._done}/{self._iterations}"
        )


def _require(
    operator: Operator, data: torch.Tensor, weight: float, prior: str, iterations: int, tol: float
) -> None:
    if prior not in SMOOTH_PRIORS:
        raise ValueError(f"prior is {prior!r}; take one of {', '.join(SMOOTH_PRIORS)}")
    if not (weight >= 0 and math.isfinite(weight)):
        raise ValueError(f"weight is {weight:g}; give 0 or more")
    require_count("iterations", iterations)
    require_positive("tol", tol, "")
    if tuple(data.shape) != operator.codomain:
        raise ValueError(f"data are {tuple(data.shape)}; the operator gives {operator.codomain}")
    require_finite("data", data)


def _gain(operator: Operator) -> float:
    """Of even light, or where that cancels of what gets through best."""
    even = float(operator(torch.ones(operator.domain, dtype=torch.float64)).mean())
    gain = abs(even) or operator.norm()
    if not gain > 0:
        raise ValueError("operator lets nothing through; there is nothing to be restored")
    return gain


def _validate_weights(
    y: torch.Tensor, weights: torch.Tensor | None, clipped: torch.Tensor | None
) -> tuple[torch.Tensor | None, torch.Tensor | None]:
    require_same_shape("data", y, weights=weights, clipped=clipped)
    if weights is not None:
        require_weights(weights)
        weights = weights.to(torch.float64)
    return weights, None if clipped is None else clipped.to(torch.bool)


def _bounds(
    operator: Operator, lower: float | torch.Tensor, upper: float | torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    low, high = (
        torch.as_tensor(one, dtype=torch.float64).broadcast_to(operator.domain)
        for one in (lower, upper)
    )
    if not bool((low <= high).all()):
        bad = int((~(low <= high)).sum())
        raise ValueError(f"lower is above upper, or NaN, at {bad} samples; bounds mustn't cross")
    return low, high


def _extend_bound(
    bound: float | torch.Tensor, observation: Observation, name: str
) -> float | torch.Tensor:
    """A bound of the frame's pixels on the whole period."""
    given = torch.as_tensor(bound, dtype=torch.float64)
    if not given.ndim:
        return float(given)
    if given.shape != observation.image.shape:
        raise ValueError(
            f"{name} is {tuple(given.shape)} and image {tuple(observation.image.shape)}; give "
            "a number, or one for each pixel"
        )
    whole = torch.full(
        observation.period_shape, float(given.min() if name == "lower" else given.max())
    )
    whole = whole.to(torch.float64)
    observation.crop_to_frame(whole).copy_(given)
    return whole


def _default_weight(observation: Observation, prior: SmoothPrior) -> float:
    if prior == "total variation":
        found = total_variation(observation, iterations=_WEIGHT_ITERATIONS).weight
    elif prior == "gradient":
        # wiener() weighs the square of cycles per pixel.
        found = (wiener(observation, steps=0).weight or 0.0) / (2 * math.pi) ** 2
    else:
        found = wiener(observation, penalty_kind="flat", steps=0).weight
    return found or 0.0


def _residual(observation: Observation, spread: torch.Tensor) -> float:
    """Rms of what is left unexplained of trusted pixels, over the noise."""
    squares = (spread - observation.normalised_image).square()
    if observation.effective_weights is not None:
        squares = (
            squares
            * observation.effective_weights
            * observation.effective_weights.numel()
            / (observation.effective_weights > 0).sum()
        )
    return math.sqrt(float(squares.mean())) / observation.scene_noise


METHOD = RestorationMethod(
    "few edges, light never negative, by a general minimiser (Eq. 2.32)",
    restore_within_bounds, {50: 4.4, 100: 4.4}, 100, SETUP_COST, lambda _: RestorationCost(8, 300),
)  # fmt: skip
