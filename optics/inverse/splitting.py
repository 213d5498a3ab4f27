"""One iteration by splitting for all data terms, priors and pictures of several bands.

A restoration minimises a data term plus a weight times penalties of D x. With every D x split off
as a variable of its own, an iteration has two parts: the splits' steps, which act on single pixels,
and the picture's step, a linear system. With dual variables, it is the alternating direction method
of multipliers (ADMM; Boyd et al. 2011, doi 10.1561/2200000016). Without them and with couplings
that grow, it is half-quadratic splitting.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.observation import Observation
from optics.inverse.priors import Prior
from optics.inverse.restored_image import RestoredImage, has_converged, relative_change
from optics.progress import Progress


class PictureStep(ABC):
    """Base class of the step for the picture.

    Pictures are (bands, rows, columns), on the observation's period.
    """

    def __init__(self, observation: Observation) -> None:
        self.observation = observation

    @abstractmethod
    def next_picture(self, priors: Sequence[Prior], weight: float) -> torch.Tensor:
        """Compute the next picture from the photograph and the priors' splits."""

    @property
    @abstractmethod
    def mean_squared_residual(self) -> float:
        """The last picture's mean squared residual, relative to the noise variance."""

    def residual_of(self, picture: torch.Tensor) -> float:
        """Return the mean squared residual of any picture."""
        seen = self.observation
        light = irfft2(rfft2(picture) * seen.otf, seen.period_shape)
        return seen.mean_squared_residual(light)

    def start(self) -> torch.Tensor:
        """Return the picture before the first step: the photograph, extended to the period."""
        return self.observation.extended_image.reshape(-1, *self.observation.period_shape)

    def visible_picture(self, picture: torch.Tensor) -> torch.Tensor:
        """Return what a camera without blur would see of the picture."""
        return picture


@dataclass(frozen=True)
class SplittingSettings:
    """The number of iterations, and how the weight is found.

    iterations: largest number of iterations.
    weight: regularisation weight of the penalty in the first iterations.
    estimate_weight: the next weight, for the last picture, the last weight and the mean squared
        residual. The weight is fixed if None.
    weight_delay: number of iterations before the weight is estimated.
    tol: relative change of the picture at which the iteration ends; 0 for all iterations.
    starts_from_picture: whether the first iteration splits the first picture, as half-quadratic
        splitting does. Otherwise it starts with the picture's step.
    """

    iterations: int
    weight: float
    estimate_weight: Callable[[torch.Tensor, float, float], float] | None = None
    weight_delay: int = 0
    tol: float = 0.0
    starts_from_picture: bool = False


@dataclass(frozen=True, eq=False)
class SplitSolution:
    """The picture that the iterations end with.

    picture: (bands, rows, columns), on the period.
    weight: the last regularisation weight.
    relative_changes: relative change of the picture in each iteration.
    converged: whether the tolerance was reached, or without one, whether further iterations would
        change the picture by little.
    """

    picture: torch.Tensor
    weight: float
    relative_changes: list[float]
    converged: bool


def solve_by_splitting(
    step: PictureStep,
    priors: Sequence[Prior],
    settings: SplittingSettings,
    method: str,
    progress: Progress,
    start: torch.Tensor | None = None,
) -> SplitSolution:
    """Run the iterations.

    method: name for progress reports.
    start: first picture, (bands, rows, columns); the photograph if None.
    """
    picture = step.start() if start is None else start
    weight, changes, count = settings.weight, list[float](), settings.iterations
    for number in range(count):
        progress.report(number / count, f"{method} {number + 1}/{count}")
        if number or settings.starts_from_picture:
            for prior in priors:
                prior.update(picture, weight)
        before, picture = picture, step.next_picture(priors, weight)
        if settings.estimate_weight is not None and number >= settings.weight_delay:
            weight = settings.estimate_weight(picture, weight, step.mean_squared_residual)
        seen, old = (step.visible_picture(one) for one in (picture, before))
        changes.append(relative_change(seen, old))
        if settings.tol and changes[-1] <= settings.tol:
            return SplitSolution(picture, weight, changes, True)
    converged = not settings.tol and has_converged(changes)
    return SplitSolution(picture, weight, changes, converged)


def restored_image(
    step: PictureStep,
    solution: SplitSolution,
    method: str,
    converged: bool | None = None,
    upper: float = math.inf,
) -> RestoredImage:
    """Gather the result, with light from 0 to `upper`.

    A picture of one band is (rows, columns).

    method: the method's name.
    converged: follows from the relative changes if None.
    """
    with torch.no_grad():
        uncut = step.mean_squared_residual**0.5
        cut = _residual_within_bounds(step, solution.picture.detach(), upper)
    whole = step.visible_picture(solution.picture)
    whole = whole[0] if len(whole) == 1 else whole
    changes = solution.relative_changes
    return RestoredImage(
        step.observation.crop_to_picture(whole).clamp(min=0, max=upper),
        method,
        step.observation.noise,
        uncut if cut is None else cut,
        solution.weight,
        len(changes),
        changes,
        solution.converged if converged is None else converged,
        whole,
        None if cut is None else uncut,
    )


def _residual_within_bounds(step: PictureStep, picture: torch.Tensor, upper: float) -> float | None:
    """Return the rms residual after the frame is cut to its bounds; None if nothing is cut.

    The scene around the frame stays as it explains the photograph, or is made dark where it is
    known to be.
    """
    seen = step.observation
    shown = picture.clone() if seen.support is None else picture * seen.support
    rows, columns = seen.picture_window
    shown[..., rows, columns].clamp_(min=0, max=upper)
    return None if torch.equal(shown, picture) else step.residual_of(shown) ** 0.5


def damped_weight(
    target: float, weight: float, initial: float, min_factor: float, max_factor: float
) -> float:
    """Move a weight 30 % of the way to its target, in logarithms.

    The target is limited to `min_factor` to `max_factor` times the initial weight. Before the
    iterations have converged, the picture explains too little, and would ask for less weight.
    """
    target = min(max(target, initial * min_factor), initial * max_factor)
    return weight * (target / weight) ** 0.3
