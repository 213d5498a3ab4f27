"""What a bench is to be measured for, and the design that its plan carries."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_whole
from labapp.files.quantities import Nanometres, Positive
from labapp.files.reading import FileModel

Part = Literal["registration", "response", "wavefront", "zeroth"]

PARTS: tuple[Part, ...] = ("registration", "response", "wavefront", "zeroth")

Vector = tuple[float, float]

NEUTRAL_NAME = "neutral"
"""Name of the neutral pattern."""

DESIGN_KEY = "calibration_design"
"""Key of a plan's metadata under which the design is stored as JSON."""


class CalibrationRequest(FileModel):
    """Hold what a user asks a calibration to measure.

    regions: (rows, columns) into which the panel is divided. levels: frames of the sweep. star,
    dark: names of the targets. dark may be "" if the lamp can't be covered; the sensor's black
    level is then used. star_diameter_um, star_distance_m: of the pinhole; only the wavefront
    needs them. exposure_ms: of the neutral star, unclipped; found by trial if None.
    """

    wavelengths_nm: Annotated[tuple[Nanometres, ...], Field(min_length=1)]
    regions: tuple[Annotated[int, Field(ge=1, le=16)], Annotated[int, Field(ge=1, le=16)]] = (2, 2)
    parts: Annotated[tuple[Part, ...], Field(min_length=1)] = PARTS
    levels: Annotated[int, Field(ge=16, le=256)] = 40
    star: str = "star"
    dark: str = "dark"
    star_diameter_um: Positive | None = None
    star_distance_m: Positive | None = None
    exposure_ms: Positive | None = None

    def includes(self, part: Part) -> bool:
        return part in self.parts


def parse_regions(text: str) -> tuple[int, ...]:
    """Parse the rows and columns of the panel's regions, as in 2x2."""
    try:
        rows, columns = (parse_whole(one) for one in text.split("x"))
    except ValueError as error:
        raise UserError(f"--regions {text}: give rows x columns, as in 2x2.") from error
    return rows, columns


class CalibrationExposures(FileModel):
    """Hold a calibration's exposures at one wavelength, in milliseconds.

    full_ms: for the neutral star. sweep_ms: for the regions' spots. trials: number of trial
    frames that were taken to find them.
    """

    wavelength_nm: Nanometres
    full_ms: Positive
    sweep_ms: Positive
    trials: Annotated[int, Field(ge=0)] = 0


class CalibrationDesign(FileModel):
    """Hold what the fits of a calibration must know of its patterns; the plan's metadata has it.

    compass: grating vectors of the registration's steering gratings, (y, x) in cycles per panel
    pixel. vectors: the same of the regions' gratings, row by row. low, high: grey levels of the
    sweep's stripes, in the order of the frames. defocus_waves: waves of the defocus patterns,
    from edge to centre of the open pupil.
    """

    request: CalibrationRequest
    exposures: tuple[CalibrationExposures, ...]
    compass: tuple[Vector, ...]
    vectors: tuple[Vector, ...] = ()
    low: tuple[int, ...] = ()
    high: tuple[int, ...] = ()
    defocus_waves: tuple[float, ...] = ()

    def steering_names(self, wavelength_nm: float) -> list[str]:
        """Return the names of the steering gratings' patterns at a wavelength."""
        return [f"steer-{wavelength_nm:g}-{number}" for number in range(len(self.compass))]

    @property
    def sweep_names(self) -> list[str]:
        """The names of the sweep's patterns, in the order of the frames."""
        levels = zip(self.low, self.high, strict=True)
        return [f"stripes-{low:03d}-{high:03d}" for low, high in levels]

    @property
    def defocus_names(self) -> list[str]:
        """The names of the defocus patterns."""
        nm = self.reference_nm
        return [f"defocus-{nm:g}-{number}" for number in range(len(self.defocus_waves))]

    @property
    def reference_nm(self) -> float:
        """Return the middle wavelength in nm, at which the wavefront is measured."""
        return sorted(self.request.wavelengths_nm)[len(self.request.wavelengths_nm) // 2]

    def exposures_at(self, wavelength_nm: float) -> CalibrationExposures:
        return next(e for e in self.exposures if e.wavelength_nm == wavelength_nm)
