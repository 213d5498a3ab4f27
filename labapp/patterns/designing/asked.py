"""What a command line asks to be designed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ValidationError

from labapp.common.errors import UserError
from labapp.files.pattern_table import Still, VideoPattern
from labapp.files.reading import explain


@dataclass(frozen=True)
class AskedDesign:
    """A pattern, and for what.

    wavelength: metres, at which the PSF is predicted. frames: of a video, 1 for a still. side:
    sensor pixels across the predicted PSF; None for what the target needs. shown: the pattern as
    a plan would have it. UserError for one that can't be a video.
    """

    pattern: Still
    wavelength: float
    frames: int
    seed: int
    bench: Path | None
    side: int | None
    shown: Still | VideoPattern = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shown", _as_shown(self.pattern, self.frames))


def _as_shown(pattern: Still, frames: int) -> Still | VideoPattern:
    if frames == 1:
        return pattern
    try:
        return VideoPattern(kind="video", pattern=pattern, count=frames)
    except ValidationError as error:
        raise UserError(explain(error, f"{frames} frames")) from error
