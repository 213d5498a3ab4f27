"""What a command line asks to be designed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ValidationError

from labapp.common.errors import UserError
from labapp.files.pattern_table import StillPattern, VideoPattern
from labapp.files.reading import format_validation_error


@dataclass(frozen=True)
class DesignRequest:
    """A pattern, and for what.

    wavelength: metres, at which the PSF is predicted. frames: of a video, 1 for a still. side:
    sensor pixels across the predicted PSF; None for what the target needs. plan_pattern: the
    pattern as a plan would have it. UserError for one that can't be a video.
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
