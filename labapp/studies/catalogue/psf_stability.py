"""Definition of the study of the smoothness of a PSF averaged over a video (thesis Fig. 3.5)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from labapp.files.phase_table import Iterations
from labapp.files.quantities import Nanometres, Positive
from labapp.studies.contract import Study, StudySettings

Frames = Annotated[int, Field(ge=1, le=600)]


class StabilitySettings(StudySettings):
    """Hold the study's settings: the videos' numbers of frames, the PSF's size, and exposures."""

    QUICK: ClassVar[Mapping[str, Any]] = {
        "counts": [1, 3],
        "reference": 12,
        "joint": 4,
        "iterations": 10,
    }

    counts: Annotated[
        tuple[Frames, ...], Field(min_length=1, description="frames of the videos")
    ] = (1, 5, 10, 20)
    reference: Annotated[
        int, Field(ge=2, le=600, description="frames of the video that counts as truth")
    ] = 40
    joint: Annotated[
        int, Field(ge=2, le=600, description="frames of a video whose frames know of each other")
    ] = 8
    radius_um: Annotated[Positive, Field(description="of the spiral on the sensor")] = 80.0
    width_um: Annotated[Positive, Field(description="of its stroke, standard deviation")] = 8.0
    wavelength_nm: Annotated[Nanometres, Field(description="of the filter")] = 550.0
    iterations: Annotated[Iterations, Field(description="of phase retrieval, a frame")] = 30
    neutral_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket without a pattern")
    ] = (4.0, 32.0)

    @model_validator(mode="after")
    def _require_counts_below_reference(self) -> StabilitySettings:
        if max(self.counts) >= self.reference:
            raise ValueError(
                f"counts has {max(self.counts)} frames and the reference {self.reference}; "
                "all counts must be smaller"
            )
        return self


STUDY = Study(
    title="Stability of PSFs by temporal averaging",
    source="Figure 3.5, section 3.5.2",
    shows=(
        "The PSF of a single static pattern has unwanted discontinuities, which depend on the "
        "random start of the phase retrieval; that of a video of 60 such patterns in a second is "
        "much smoother. Against it as truth, the mean square error of videos of 5, 10, ... 55 "
        "frames a second decreases quickly and levels off at 30. The curve is printed without "
        "numbers that could be read."
    ),
    method=(
        "Videos of a spiral are made of frames from independent random starts and played while "
        "the camera exposes for about a second; beside them, a video whose frames were found "
        "together. For the thesis' own lengths: reference=60 counts=[5,10,15,20,25,30,35,40,45,"
        "50,55], which takes minutes."
    ),
    settings=StabilitySettings,
    module="labapp.studies.psf_stability",
    scene="studies/dim-star.toml",
)
