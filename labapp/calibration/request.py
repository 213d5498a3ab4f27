"""What a calibration is asked to find, and the design that its plan carries."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from labapp.files.quantities import Positive
from labapp.files.reading import FileModel

Part = Literal["registration", "response", "wavefront", "zeroth"]

PARTS: tuple[Part, ...] = ("registration", "response", "wavefront", "zeroth")

MIN_LEVELS, DEFAULT_LEVELS = 16, 40

Vector = tuple[float, float]

DESIGN_KEY = "calibration_design"
"""Of a plan's metadata, under which its design is kept as JSON."""


class CalibrationRequest(FileModel):
    """What a person wants. regions: (rows, columns) of the panel. levels: frames of the sweep.

    star, dark: names of the targets; dark may be "" where the lamp can't be covered, and the
    sensor's black level then stands in. star_diameter_um, star_distance_m: of the pinhole; only
    the wavefront needs them. exposure_ms: of the neutral star, unclipped; found by trial if None.
    """

    wavelengths_nm: Annotated[tuple[Positive, ...], Field(min_length=1)]
    regions: tuple[Annotated[int, Field(ge=1, le=16)], Annotated[int, Field(ge=1, le=16)]] = (2, 2)
    parts: Annotated[tuple[Part, ...], Field(min_length=1)] = PARTS
    levels: Annotated[int, Field(ge=MIN_LEVELS, le=256)] = DEFAULT_LEVELS
    star: str = "star"
    dark: str = "dark"
    star_diameter_um: Positive | None = None
    star_distance_m: Positive | None = None
    exposure_ms: Positive | None = None

    def includes(self, part: Part) -> bool:
        return part in self.parts


class CalibrationExposures(FileModel):
    """Seconds at a wavelength: full, of a neutral star; sweep, of the regions' spots. trials:
    frames that were spent to find them."""

    wavelength_nm: Positive
    full_ms: Positive
    sweep_ms: Positive
    trials: Annotated[int, Field(ge=0)] = 0


class CalibrationDesign(FileModel):
    """Everything that the fits must know of what was shown; a plan carries it as metadata.

    compass: vectors of the registration's gratings, cycles per panel pixel, (y, x). vectors: of
    the regions' gratings, row by row. low, high: grey levels of the sweep's stripes, frame by
    frame in the order in which they were taken. defocus_waves: of the diversity patterns, edge
    to centre of the open pupil.
    """

    request: CalibrationRequest
    exposures: tuple[CalibrationExposures, ...]
    compass: tuple[Vector, ...]
    vectors: tuple[Vector, ...] = ()
    low: tuple[int, ...] = ()
    high: tuple[int, ...] = ()
    defocus_waves: tuple[float, ...] = ()

    @property
    def reference_nm(self) -> float:
        """The wavelength at which the wavefront is measured: the middle one."""
        return sorted(self.request.wavelengths_nm)[len(self.request.wavelengths_nm) // 2]

    def exposures_at(self, wavelength_nm: float) -> CalibrationExposures:
        return next(e for e in self.exposures if e.wavelength_nm == wavelength_nm)


NEUTRAL_NAME = "neutral"
"""Of the patterns; they and the names below are alike in plan and record."""


def steering_pattern_name(wavelength_nm: float, number: int) -> str:
    return f"steer-{wavelength_nm:g}-{number}"


def stripes_pattern_name(low: int, high: int) -> str:
    return f"stripes-{low:03d}-{high:03d}"


def defocus_pattern_name(wavelength_nm: float, number: int) -> str:
    return f"defocus-{wavelength_nm:g}-{number}"
