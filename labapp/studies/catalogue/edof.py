"""Definition of the study of extended depth of field by a designed pattern (thesis chapter 5)."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field

from labapp.files.quantities import Nanometres, Positive
from labapp.studies.contract import Study, StudySettings

DISTANCES = (0.5, 0.62, 0.75, 0.8, 1.0, 1.5, 2.0, 3.5, 5.0, 50.0)
"""Test distances in metres of thesis Eq. 5.11."""


class EdofSettings(StudySettings):
    """Hold the study's settings: the pattern, the distances, the exposures, what is compared."""

    QUICK: ClassVar[dict[str, Any]] = {
        "distances_m": [0.5, 1.0, 50.0],
        "star_ms": [5, 40, 320, 2560, 20000],
        "frame_px": 512,
        "layered": False,
    }

    pattern: Annotated[
        str,
        Field(description="file of labapp train edof or design edof; empty: the bundled pattern"),
    ] = ""
    distances_m: Annotated[
        tuple[Positive, ...],
        Field(min_length=1, description="of targets star-50cm, photograph-50cm and so on"),
    ] = DISTANCES
    wavelength_nm: Annotated[Nanometres, Field(description="of the filter")] = 520.0
    star_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the stars")
    ] = (5.0, 20.0, 80.0, 320.0, 1280.0, 5120.0, 20000.0)
    scene_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the photographs")
    ] = (4000.0,)
    sharp_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of what pictures should be")
    ] = (1000.0, 4000.0)
    psf_px: Annotated[
        int, Field(ge=33, le=941, description="side of the PSFs that are compared, odd")
    ] = 901
    frame_px: Annotated[
        int, Field(ge=64, le=2048, description="side of the middle of the frame that is decoded")
    ] = 1024
    scored_px: Annotated[int, Field(ge=32, description="side of its middle that is scored")] = 448
    layered: Annotated[
        bool, Field(description="photograph objects that hide each other, too; takes minutes")
    ] = True


STUDY = Study(
    title="Extended depth of field by a designed pattern",
    source="Figures 5.7 to 5.11 and 5.13, Tables 5.1 and 5.2, section 5.7",
    shows=(
        "A pattern that is learned together with a decoder has PSFs that hardly depend on the "
        "distance. Measured PSFs resemble the simulated ones, but for blur. Pictures of test "
        "charts at many distances are decoded; mean PSNR is 30 to 32 dB in simulation. A scene "
        "with three objects at three distances fails at edges."
    ),
    method=(
        "Stars, a print and objects that hide each other are photographed with the designed "
        "pattern, with hand-made rings and without a pattern. Stars give the PSFs, which are "
        "compared with simulated ones. Pictures are decoded by one Wiener filter for all "
        "distances, alone and with the trained network behind it, and compared with pictures of "
        "the same things in focus."
    ),
    settings=EdofSettings,
    module="labapp.studies.edof",
    scene="studies/edof.toml",
    bench="studies/edof-bench.toml",
)
