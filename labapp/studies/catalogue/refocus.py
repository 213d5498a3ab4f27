"""Definition of the study of refocusing by a Fresnel lens on the SLM (thesis Fig. 3.6)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from labapp.files.quantities import Nanometres, Positive
from labapp.studies.contract import Study, StudySettings


class RefocusSettings(StudySettings):
    """Hold the study's settings: the distance to focus on, the stars' distances, and exposures."""

    QUICK: ClassVar[Mapping[str, Any]] = {"stars_m": [1.4, 1.6, 2.0]}

    near_m: Annotated[
        Positive, Field(description="distance that the lens on the SLM is to bring into focus")
    ] = 1.6
    stars_m: Annotated[
        tuple[Positive, ...],
        Field(min_length=3, description="distances of stars: targets star-160cm and so on"),
    ] = (1.4, 1.6, 1.8, 2.0, 2.4)
    bricks: Annotated[
        bool, Field(description="photograph them too; a simulated bench takes minutes a frame")
    ] = False
    wavelength_nm: Annotated[Nanometres, Field(description="of the filter")] = 550.0
    star_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the stars")
    ] = (1.0, 16.0, 256.0)
    scene_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the bricks")
    ] = (100.0, 800.0)


STUDY = Study(
    title="Refocusing by a Fresnel lens on the SLM",
    source="Figure 3.6, section 3.5.3",
    shows=(
        "Three bricks stand at three distances, and the camera is focused on the farthest. With "
        "a Fresnel lens on the SLM a nearer figure becomes sharp, as one sees on its arm and "
        "head; every object has a halo of light that wasn't modulated. No numbers are printed."
    ),
    method=(
        "The power of the Fresnel lens follows from the thin-lens equation. Stars at several "
        "distances are photographed without a pattern and with the lens; with bricks=true, so "
        "are bricks."
    ),
    settings=RefocusSettings,
    module="labapp.studies.refocus",
    scene="studies/refocus.toml",
)
