"""Messages between window and engine for finding, focusing, exposing and keeping.

All is measured in the engine, on the camera's own numbers: only these few travel.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.window.commands import Command

PixelRegion = tuple[int, int, int, int]
"""First row, first column, rows and columns of a rectangle of pixels."""

PixelLine = tuple[tuple[float, float], tuple[float, float]]
"""Both ends of a line: row and column, where whole numbers are the centres of pixels."""


@dataclass(frozen=True)
class MeasurePictures(Command):
    """Measure live pictures from now on in a region and along a line, each where it isn't None."""

    region: PixelRegion | None
    line: PixelLine | None


@dataclass(frozen=True)
class FindStar(Command):
    """Find the star that stands out most in the whole of the last live picture."""


@dataclass(frozen=True)
class FindExposure(Command):
    """Set the exposure that brings the brightest pixel of a region to a level.

    level: share of the range from the black level to full scale.
    region: None for the whole picture.
    """

    level: float
    region: PixelRegion | None


@dataclass(frozen=True)
class ProposeBracket(Command):
    """Propose a bracket for the light that the camera sees now, as `labapp bracket` does.

    The ratio is 20 log10 of each merged pixel, over decades below the brightest pixels.
    row: the bracket that it is meant for.
    """

    row: str
    snr_db: float
    decades: float


@dataclass(frozen=True)
class KeepPicture(Command):
    """Write the live picture of this number to a new file in `folder`, with its settings."""

    number: int
    folder: Path


# The engine sends the following messages to the window.


@dataclass(frozen=True)
class StarReading:
    """Place and width of a star.

    y, x: row and column in the picture.
    fwhm_major, fwhm_minor: full widths at half maximum along the long and the short axis, pixels.
    peak: DN above the background.
    angle: radians from the columns' direction towards the rows'.
    """

    y: float
    x: float
    fwhm_major: float
    fwhm_minor: float
    angle: float
    peak: float
    saturated: int

    @property
    def fwhm(self) -> float:
        """Return the geometric mean of both widths."""
        return float(np.sqrt(self.fwhm_major * self.fwhm_minor))


@dataclass(frozen=True)
class RegionReading:
    """Statistics of a region in DN, and its focus score in 1/pixel².

    region: the part within the picture.
    no_focus: why there is no score.
    no_star: why there is no star.
    """

    region: PixelRegion
    mean: float
    deviation: float
    lowest: int
    highest: int
    saturated: int
    at_zero: int
    focus: float | None
    no_focus: str
    star: StarReading | None
    no_star: str


@dataclass(frozen=True, eq=False)
class LineReading:
    """Numbers along a line: pixels from its start, and DN."""

    distances: NDArray[np.float64]
    values: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PictureMeasured:
    """What was measured in the live picture of a number.

    target, wavelength: what the picture was taken of, m; measurements of different ones don't
        compare.
    taken_at: s, on the engine's clock.
    """

    number: int
    target: str
    wavelength: float
    taken_at: float
    region: RegionReading | None
    line: LineReading | None


@dataclass(frozen=True)
class StarFound:
    """Where a star was found, (row, column), or why there is none."""

    place: tuple[float, float] | None
    why_not: str = ""


@dataclass(frozen=True)
class ExposureFound:
    """The exposure that was set, and what level it reaches.

    exposure: s.
    level, wanted: shares of the range to full scale.
    limit: end of the camera's range that keeps the level from being reached; empty if none does.
    """

    exposure: float
    level: float
    wanted: float
    frames: int
    limit: str


@dataclass(frozen=True)
class BracketProposal:
    """A proposed bracket, and what it was proposed for.

    exposures_ms: each frame's, the shortest first.
    electrons_per_s: range, the lower rate first.
    seconds: those of the bracket with read-out.
    ladders: seconds of the ladders that reach the same, by name.
    """

    row: str
    target: str
    pattern: str
    wavelength: float
    snr_db: float
    least_snr_db: float
    electrons_per_s: tuple[float, float]
    exposures_ms: tuple[float, ...]
    seconds: float
    ladders: tuple[tuple[str, float], ...]
    metering_frames: int
