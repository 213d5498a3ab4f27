"""Definition of the study of PSFs of many shapes (thesis Fig. 3.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from labapp.files.phase_table import Iterations
from labapp.files.quantities import Nanometres, Positive
from labapp.studies.contract import Study, StudySettings

Shape = Literal["eye", "letters", "heart", "infinity", "spiral", "ring"]

PUBLISHED_SHAPES: tuple[Shape, ...] = ("eye", "letters", "heart", "infinity", "spiral")
"""Shapes of the published PSFs, in the order of Fig. 3.3."""


class ShapesSettings(StudySettings):
    """Hold the study's settings: the PSFs' shapes and sizes, phase retrieval, and exposures."""

    QUICK: ClassVar[Mapping[str, Any]] = {"shapes": ["heart", "ring"], "iterations": 10}

    shapes: Annotated[
        tuple[Shape, ...], Field(min_length=1, description="eye, letters, heart ... ring")
    ] = (*PUBLISHED_SHAPES, "ring")
    text: Annotated[str, Field(min_length=1, max_length=8, description="of the letters")] = "EI"
    radius_um: Annotated[Positive, Field(description="of the shapes on the sensor")] = 100.0
    width_um: Annotated[Positive, Field(description="of their strokes, standard deviation")] = 8.0
    wavelength_nm: Annotated[Nanometres, Field(description="of the filter")] = 550.0
    iterations: Annotated[Iterations, Field(description="of phase retrieval")] = 60
    exposures_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the star")
    ] = (1.0, 8.0, 64.0, 512.0)


STUDY = Study(
    title="PSFs of many shapes",
    source="Figure 3.3, section 3.5.1",
    shows=(
        "Captured PSFs, on a logarithmic scale: an eye, the letters EI, a heart, the symbol of "
        "infinity, a spiral, and the pattern for the spiral. All have a prominent central peak of "
        "light that wasn't modulated, and visible speckle. No numbers are printed. The authors "
        "published the patterns and computed PSFs of a ring beside their program."
    ),
    method=(
        "A pattern is retrieved for each shape, shown on the SLM, and an artificial star is "
        "photographed in a bracket of exposures, with dark frames."
    ),
    settings=ShapesSettings,
    module="labapp.studies.psf_shapes",
)
