"""Settings that the studies of multispectral imaging share (thesis chapter 4)."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.phase_table import Iterations
from labapp.files.quantities import Nanometres, Positive
from labapp.studies.contract import StudySettings

Bands = Annotated[
    tuple[Annotated[float, Field(ge=400, le=720)], ...],
    Field(min_length=2, max_length=31, description="central wavelengths of the bands, rising"),
]

Exposures = Annotated[tuple[Positive, ...], Field(min_length=1)]

SIX_BANDS = (450.0, 500.0, 550.0, 600.0, 650.0, 700.0)
"""Central wavelengths in nanometres of the published bands (Fig. 4.3)."""


class PSFStackSettings(StudySettings):
    """Hold the settings of a study's PSFs: bands, size, phase retrieval, and the star's exposures.

    The default radius is 20 pixels of 7.4 µm at 700 nm: a PSF grows with the wavelength.
    """

    bands_nm: Bands = SIX_BANDS
    radius_um: Annotated[
        Positive, Field(description="of the PSF on the sensor, at wavelength_nm")
    ] = 116.0
    width_um: Annotated[Positive, Field(description="of its stroke, standard deviation")] = 6.0
    wavelength_nm: Annotated[Nanometres, Field(description="for which patterns are retrieved")] = (
        550.0
    )
    iterations: Annotated[Iterations, Field(description="of phase retrieval")] = 30
    star_ms: Annotated[Exposures, Field(description="bracket of the star without a pattern")] = (
        10.0,
        80.0,
    )
    coded_star_ms: Annotated[
        Exposures, Field(description="bracket of the star with a pattern, whose light is spread")
    ] = (80.0, 1000.0)

    @model_validator(mode="after")
    def _require_rising_bands(self) -> PSFStackSettings:
        if any(one >= other for one, other in pairwise(self.bands_nm)):
            listed = ", ".join(f"{one:g}" for one in self.bands_nm)
            raise ValueError(f"bands_nm is {listed}; give rising wavelengths, each once")
        return self


class SnapshotSettings(PSFStackSettings):
    """Hold the settings of a study's coded snapshot: also the scene and its exposures."""

    target: Annotated[
        Literal["checker", "beads"], Field(description="a ColorChecker, or beads of its colours")
    ] = "checker"
    scene_ms: Annotated[Exposures, Field(description="bracket of the scene")] = (100.0, 800.0)
    sheet_ms: Annotated[Exposures, Field(description="bracket of a white sheet")] = (50.0, 200.0)
