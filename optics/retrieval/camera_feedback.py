"""Refine a pattern by pictures of its PSF that a camera takes.

No model describes a bench completely: flatness, phase response, coupling and unmodulated light
change the PSF. So the PSF's picture from the camera, resampled to the design grid, replaces the
computed mean intensity (feedback by camera: Schroff et al., Sci. Rep. 13, 3252, 2023).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from optics.metrics import scaled_nrmse
from optics.progress import Progress
from optics.retrieval.frame_averaging import correct_request, mean_intensity, scale_to_mean
from optics.retrieval.gerchberg_saxton import over_compensated_constraint
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import coarsest_superpixels
from optics.threads import single_threaded

MeasurePSF = Callable[[torch.Tensor, Progress], torch.Tensor]
"""Type of a function that shows phases (frames, rows, columns) on a bench and measures their PSF.

It returns the mean PSF on the goal's plane, on any scale and nowhere negative.
"""

CameraBlur = Callable[[torch.Tensor], torch.Tensor]
"""Type of a function that blurs a PSF on the goal's plane as a camera does.

The blur is that of the camera's pixels and of the artificial star.
"""

JUDGED_TARGET_SHARE = 0.02
"""Share of the target's peak above which a picture's error is measured.

Unmodulated light beside the target is thereby excluded.
"""


# Iterations of the model after each picture, and before the first one for several frames. Chosen.
_ITERATIONS, _FIRST_ITERATIONS = 5, 20

# Gain of the over-compensation of a single frame. It is below 1, because the pictures correct the
# same error as well. Chosen.
_SINGLE_FRAME_GAIN = 0.5


@dataclass(frozen=True)
class RefinementResult:
    """Phases of the best measured pattern or video, and the error of every picture.

    Parameters
    ----------
    phases : torch.Tensor, (frames, rows, columns), float32
        Phases of the best picture, radians.
    errors : list of float
        NRMSE of each picture where the target exceeds 2 % of its peak. The first is the start's.
    """

    phases: torch.Tensor
    errors: list[float]

    @property
    def best(self) -> int:
        """Return the index of the picture with the least error; 0 is the start."""
        return min(range(len(self.errors)), key=self.errors.__getitem__)


@single_threaded
def refine(
    goal: RetrievalGoal,
    phases: torch.Tensor,
    measure: MeasurePSF,
    pictures: int,
    *,
    blur: CameraBlur | None = None,
    progress: Progress | None = None,
) -> RefinementResult:
    """Correct a phase pattern or video by pictures that a camera takes of its PSF.

    The result is the start itself if no correction improved it. Videos gain most, because their
    mean can have any shape, while the PSF of a single frame can't. Calibrate the wavefront first:
    the function corrects small residual errors, but not those of a quarter of a wave.

    Parameters
    ----------
    goal : RetrievalGoal
        Target, camera and wavelength.
    phases : torch.Tensor, (frames, rows, columns)
        A solution without the camera, radians, as `retrieve` gives it.
    measure : callable
        A bench with its camera: a `MeasurePSF`, called with the phases and a Progress.
    pictures : int
        Number of pictures, 2 or more. The first shows the start; the last is only measured.
    blur : callable, optional
        Turns a PSF on the goal's plane into what the camera sees of it: its pixels and the
        artificial star have a width. None for a camera without blur.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    RefinementResult
        Phases of the best picture, and the errors of all of them.

    Raises
    ------
    ValueError
        If `pictures` is below 2, or a picture has another shape than the target, is dark where the
        target is bright, negative anywhere, or not finite.
    """
    if pictures < 2:
        raise ValueError(f"pictures is {pictures}; two at least: before a correction and after")
    progress = progress or Progress()
    pixels = coarsest_superpixels(goal)
    target = pixels.target_intensity
    seen_target = target if blur is None else blur(target)
    bright = seen_target > JUDGED_TARGET_SHARE * seen_target.max()
    wanted = target
    # The fields are those of superpixels, each of which is one sample instead of side² pixels.
    shown_fields = (torch.polar(goal.amplitude, phase.to(torch.float32)) for phase in phases)
    on_window = torch.stack([goal.far_field.forward(field) for field in shown_fields])
    fields = pixels.to_superpixel_origin(on_window) / pixels.side**2
    for _ in range(_FIRST_ITERATIONS if len(fields) > 1 else 0):
        # The request whose result is the target doesn't follow from the phases, so the model
        # iterates towards it first.
        wanted = correct_request(wanted, target, mean_intensity(fields))
        fields = pixels.far_field.round_trip(
            _constrained_fields(fields, wanted), pixels.uneven_amplitude
        )
    shown, errors = [phases.to(torch.float32)], list[float]()
    for number in range(pictures):
        part = progress.part(number / pictures, (number + 1) / pictures)
        seen = measure(shown[-1], part)
        _require_usable(seen, target)
        seen = seen.to(torch.float32)
        errors.append(scaled_nrmse(seen[bright], seen_target[bright]))
        # Only the best and the latest phases are kept, because videos are large.
        shown = [shown[0] if errors[-1] > min(errors) else shown[-1]]
        if number == pictures - 1:
            break
        wanted = correct_request(wanted, seen_target, seen)
        for _ in range(_ITERATIONS):
            asked = _constrained_fields(fields, wanted)
            fields = pixels.far_field.round_trip(asked, pixels.uneven_amplitude)
        shown.append(pixels.pixel_phases(asked))
    return RefinementResult(shown[0], errors)


def _constrained_fields(fields: torch.Tensor, request: torch.Tensor) -> torch.Tensor:
    """Constrain the frames' fields on the window to a requested mean intensity."""
    # Scaling wouldn't correct a single frame, so it is over-compensated instead.
    if len(fields) == 1:
        return over_compensated_constraint(request, _SINGLE_FRAME_GAIN)(fields)
    return torch.stack(scale_to_mean(fields, mean_intensity(fields), request))


def _require_usable(picture: torch.Tensor, target: torch.Tensor) -> None:
    """Raise ValueError unless a camera's picture is fit for corrections."""
    if picture.shape != target.shape:
        raise ValueError(
            f"the camera's picture is {tuple(picture.shape)} and the target {tuple(target.shape)}; "
            "lay it on the design grid first"
        )
    if not (torch.isfinite(picture).all() and picture.min() >= 0 and picture[target > 0].sum() > 0):
        raise ValueError(
            "the camera's picture must be finite, nowhere negative, and lit where the target is; "
            "subtract a dark frame, cut at zero, and look whether the pattern is shown"
        )
