"""Definition of the study of extended depth of field by a cubic phase (thesis Fig. 2.15-2.17)."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field

from labapp.files.quantities import Nanometres, Positive
from labapp.studies.contract import Study, StudySettings


class CubicEdofSettings(StudySettings):
    """Hold the study's settings: the strength of the cubic phase, and the exposures."""

    QUICK: ClassVar[dict[str, Any]] = {"scene_ms": [400], "iterations": 6}

    strength_rad: Annotated[
        Positive, Field(description="cubic phase at the panel's longer half")
    ] = 40.0
    wavelength_nm: Annotated[Nanometres, Field(description="of the filter")] = 550.0
    star_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the stars")
    ] = (4.0, 64.0, 512.0)
    scene_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the photographs")
    ] = (100.0, 400.0, 1600.0)
    iterations: Annotated[int, Field(ge=1, le=200, description="of the joint restoration")] = 15


STUDY = Study(
    title="Extended depth of field by a cubic phase",
    source="Figures 2.15 to 2.17, section 2.5",
    shows=(
        "A cubic phase plate makes PSFs that hardly depend on defocus, where those of the open "
        "aperture do; a photograph with a near and a far part is blurred alike by it, and restored "
        "as a whole by one deconvolution. A depth mask tells the parts. No numbers are printed."
    ),
    method=(
        "The cubic phase is shown on the SLM. Stars at 2 m, in focus, and at 2.2 m give the PSFs; "
        "a photograph with parts at both distances is taken with and without the plate, and "
        "restored with one PSF, and with the PSF of each depth."
    ),
    settings=CubicEdofSettings,
    module="labapp.studies.cubic_edof",
    scene="studies/cubic-edof.toml",
    bench="studies/cubic-edof-bench.toml",
)
