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
from optics.inverse.restored_image import (
    CONVERGED_CHANGE,
    RestoredImage,
    relative_change,
    remaining_change,
)
from optics.progress import Progress


class PictureStep(ABC):
    """Base class of the step for the picture, (bands, rows, columns), on the whole period."""

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
    """The largest number of iterations, and how the weight is found.

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
    """The picture that the iterations end with, (bands, rows, columns), and the last weight.

    relative_changes: of the picture in each iteration.
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
    """Run the iterations from `start`, (bands, rows, columns), or the photograph if None.

    method: name for progress reports.
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
        seen = step.visible_picture(picture)
        changes.append(relative_change(seen, step.visible_picture(before)))
        if settings.tol and changes[-1] <= settings.tol:
            return SplitSolution(picture, weight, changes, True)
    converged = not settings.tol and remaining_change(changes) <= CONVERGED_CHANGE
    return SplitSolution(picture, weight, changes, converged)


def restored_image(
    step: PictureStep,
    solution: SplitSolution,
    method: str,
    converged: bool | None = None,
    upper: float = math.inf,
) -> RestoredImage:
    """Gather the result, with light from 0 to `upper`; a picture of one band is (rows, columns).

    converged: follows from the relative changes if None.
    """
    seen, picture = step.observation, solution.picture
    whole = step.visible_picture(picture)
    whole = whole[0] if len(whole) == 1 else whole
    with torch.no_grad():
        uncut = residual = step.mean_squared_residual**0.5
        # The frame is cut to its bounds. The scene around it stays as it explains the photograph,
        # or is made dark where it is known to be.
        shown = picture.detach().clone()
        if seen.support is not None:
            shown *= seen.support
        window = [slice(None), slice(None)]
        if seen.border != "periodic":
            for axis, n in enumerate(seen.image.shape):
                first = seen.period_shape[axis] // 2 - n // 2 + seen.offset[axis]
                window[axis] = slice(max(first, 0), max(first + n, 0))
        shown[..., window[0], window[1]].clamp_(min=0, max=upper)
        is_cut = not torch.equal(shown, picture)
        if is_cut:
            residual = step.residual_of(shown) ** 0.5
    changes = solution.relative_changes
    return RestoredImage(
        seen.crop_to_picture(whole).clamp(min=0, max=upper),
        method,
        seen.noise,
        residual,
        solution.weight,
        len(changes),
        changes,
        solution.converged if converged is None else converged,
        whole,
        uncut if is_cut else None,
    )
