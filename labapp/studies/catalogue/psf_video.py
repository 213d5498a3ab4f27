"""Definition of the study of a PSF that changes with time (thesis Fig. 3.4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from labapp.files.phase_table import Iterations
from labapp.files.quantities import Nanometres, Positive
from labapp.studies.contract import Study, StudySettings


class VideoSettings(StudySettings):
    """Hold the study's settings: the spiral's sizes, its phase retrieval, and the exposures."""

    QUICK: ClassVar[Mapping[str, Any]] = {"moments": 3, "iterations": 10}

    moments: Annotated[int, Field(ge=2, le=120, description="frames of the phase video")] = 10
    radius_um: Annotated[Positive, Field(description="of the spiral at first")] = 100.0
    smallest: Annotated[float, Field(gt=0, lt=1, description="share of the radius at the last")] = (
        0.4
    )
    width_um: Annotated[Positive, Field(description="of its stroke, standard deviation")] = 6.0
    turns: Annotated[float, Field(gt=0, le=10, description="of the spiral")] = 2.0
    wavelength_nm: Annotated[Nanometres, Field(description="of the filter")] = 550.0
    iterations: Annotated[Iterations, Field(description="of phase retrieval, a frame")] = 60
    exposures_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of each frame")
    ] = (1.0, 16.0, 256.0)


STUDY = Study(
    title="A PSF that changes with time",
    source="Figure 3.4, section 3.5.1",
    shows=(
        "An animation of captured PSFs, a spiral that shrinks smoothly from frame to frame of a "
        "phase video. No numbers are printed."
    ),
    method=(
        "A pattern is retrieved for each moment of a shrinking spiral. The star is photographed "
        "with each of them alone, and with the whole video, which multiplexes them in time."
    ),
    settings=VideoSettings,
    module="labapp.studies.psf_video",
)
