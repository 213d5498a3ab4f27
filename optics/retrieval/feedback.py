"""A camera in the loop: what it sees corrects what is asked for.

No model knows a bench: flatness, response, neighbours and light that isn't modulated leave
their traces in the PSF. Its picture on the camera, laid on the design grid, takes the place of
the computed mean (as feedback by camera: Schroff et al., Sci. Rep. 13, 3252, 2023).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from optics.metrics import shape_error
from optics.progress import Progress
from optics.retrieval.frames import corrected, mean_light, scaled
from optics.retrieval.gerchberg_saxton import over_compensated
from optics.retrieval.goal import Goal
from optics.retrieval.superpixel import coarsest
from optics.threads import single_threaded

Measure = Callable[[torch.Tensor, Progress], torch.Tensor]
"""From phases (frames, rows, columns) as they are to be shown to their mean PSF on the goal's
plane, any scale, nowhere negative: a bench with its camera."""

Blur = Callable[[torch.Tensor], torch.Tensor]
"""From a PSF on the goal's plane to how a camera sees it: its pixels and the star are wide."""

_INNER = 5
"""Iterations of the model for each picture."""

_BEFORE = 20
"""The same before the first correction."""

_GENTLY = 0.5
"""Of the over-compensation of a single frame: pictures correct it as well."""

BRIGHT = 0.02
"""Share of the target's peak from which a picture is judged: unmodulated light is beside it."""


@dataclass(frozen=True)
class Refined:
    """The phases of the best picture, (frames, rows, columns) float32, and what all of them
    showed: NRMSE where the target exceeds 2 % of its peak, picture by picture."""

    phases: torch.Tensor
    errors: list[float]

    @property
    def best(self) -> int:
        """Which picture was the best one; 0 is the start."""
        return min(range(len(self.errors)), key=self.errors.__getitem__)


@single_threaded
def refine(
    goal: Goal,
    phases: torch.Tensor,
    measure: Measure,
    pictures: int,
    *,
    blur: Blur | None = None,
    progress: Progress | None = None,
) -> Refined:
    """Phases that pictures have corrected, or the ones given if that made nothing better.

    phases: (frames, rows, columns), a solution without the camera, as retrieve() gives it.
    pictures: 2 or more; the first shows the start, the last only judges. Videos gain most: they
    can make any mean, where a single frame can't. Calibrate the wavefront first: this corrects
    what is left, and not a quarter of a wave. Raises ValueError for a picture of another shape,
    or one that is dark, negative or not finite.
    """
    if pictures < 2:
        raise ValueError(f"pictures is {pictures}; two at least: before a correction and after")
    progress = progress or Progress()
    pixels = coarsest(goal)
    target = pixels.intensity
    seen_target = target if blur is None else blur(target)
    bright = seen_target > BRIGHT * seen_target.max()
    wanted = target
    # A superpixel counts as one sample.
    fields = pixels.lowered(torch.stack([_far(goal, phase) for phase in phases])) / pixels.side**2
    for _ in range(_BEFORE if len(fields) > 1 else 0):
        # What has to be asked for so that the model gives the target: phases don't tell it.
        wanted = corrected(wanted, target, mean_light(fields))
        fields = pixels.far_field.bounce(_asked(fields, wanted), pixels.uneven)
    shown, errors = [phases.to(torch.float32)], list[float]()
    for number in range(pictures):
        part = progress.part(number / pictures, (number + 1) / pictures)
        seen = _checked(measure(shown[-1], part), target).to(torch.float32)
        errors.append(shape_error(seen[bright], seen_target[bright]))
        # Only the best and the latest are kept: videos are large.
        shown = [shown[0] if errors[-1] > min(errors) else shown[-1]]
        if number == pictures - 1:
            break
        wanted = corrected(wanted, seen_target, seen)
        for _ in range(_INNER):
            asked = _asked(fields, wanted)
            fields = pixels.far_field.bounce(asked, pixels.uneven)
        shown.append(pixels.pattern(asked))
    return Refined(shown[0], errors)


def _asked(fields: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Fields that are to come nearer to a mean intensity; a single one can't just be scaled."""
    if len(fields) == 1:
        return over_compensated(wanted, _GENTLY)(fields)
    return torch.stack(scaled(fields, mean_light(fields), wanted))


def _far(goal: Goal, phase: torch.Tensor) -> torch.Tensor:
    return goal.far_field.forward(torch.polar(goal.amplitude, phase.to(torch.float32)))


def _checked(seen: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    if seen.shape != target.shape:
        raise ValueError(
            f"the camera's picture is {tuple(seen.shape)} and the target {tuple(target.shape)}; "
            "lay it on the design grid first"
        )
    if not (torch.isfinite(seen).all() and seen.min() >= 0 and seen[target > 0].sum() > 0):
        raise ValueError(
            "the camera's picture must be finite, nowhere negative, and lit where the target is; "
            "subtract a dark frame, cut at zero, and look whether the pattern is shown"
        )
    return seen
