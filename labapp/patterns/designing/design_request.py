"""What the command line asks of a pattern's design."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ValidationError

from labapp.common.errors import UserError
from labapp.files.pattern_table import StillPattern, VideoPattern
from labapp.files.reading import format_validation_error


@dataclass(frozen=True)
class DesignRequest:
    """The options of `labapp pattern` and `labapp retrieve`.

    wavelength: in metres, at which the PSF is predicted.
    frames: of a video; 1 for a still pattern.
    side: of the PSF in sensor pixels; None takes the size that the target needs.
    plan_pattern: the same pattern as a plan file has it.
    Raises UserError for a pattern that can't be a video.
    """

    pattern: StillPattern
    wavelength: float
    frames: int
    seed: int
    bench: Path | None
    side: int | None
    plan_pattern: StillPattern | VideoPattern = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "plan_pattern", _as_plan_pattern(self.pattern, self.frames))


def _as_plan_pattern(pattern: StillPattern, frames: int) -> StillPattern | VideoPattern:
    if frames == 1:
        return pattern
    try:
        return VideoPattern(kind="video", pattern=pattern, count=frames)
    except ValidationError as error:
        raise UserError(format_validation_error(error, f"{frames} frames")) from error
