"""Messages about spectral cubes between window and engine, in SI units.

Both processes import this module, so it imports nothing heavy.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.window.commands import Command

Levels = NDArray[np.uint8]


@dataclass(frozen=True)
class ListBands(Command):
    """List the wavelengths at which a record has photographs through the coded pattern."""

    path: Path


@dataclass(frozen=True)
class RestoreCube(Command):
    """Restore the spectral cube of a record's coded snapshot.

    bands: what the person typed: wavelengths in nanometres, or "all".
    light: CIE illuminant in which colours are shown.
    """

    path: Path
    bands: str
    light: str


@dataclass(frozen=True)
class ShowCubeColours(Command):
    """Compute the colours of the cube that was restored last, in the CIE illuminant `light`."""

    light: str


# The engine sends the following messages to the window.


@dataclass(frozen=True)
class RecordBands:
    """Wavelengths, in metres, at which a record has the coded photograph.

    decoder: design file whose decoder belongs to the coded pattern; empty without one.
    """

    path: Path
    wavelengths: tuple[float, ...]
    decoder: str = ""


@dataclass(frozen=True, eq=False)
class CubeColours:
    """Colours of a restored cube, and of the true one, in a light.

    restored: sRGB, (rows, columns, 3).
    true: the same of the true cube, if it is known.
    difference, largest_difference: mean CIEDE2000 over the whole frame, and its 95th percentile;
        None without a truth.
    """

    light: str
    restored: Levels
    true: Levels | None
    difference: float | None
    largest_difference: float | None


@dataclass(frozen=True, eq=False)
class BandMap:
    """A map of what is uncertain or wrong in each band of a cube.

    explanation: what the map shows, in a sentence.
    caption: what the map's values are, with their unit, in a few words.
    lowest, highest: values of the levels 0 and 255; a map whose lowest value is negative has 0 in
        the middle.
    levels: map of each band, (bands, rows, columns); a single one if it is that of all bands
        together.
    """

    title: str
    explanation: str
    caption: str
    lowest: float
    highest: float
    levels: Levels


@dataclass(frozen=True)
class CubeQuality:
    """How far a restored cube is from the true one, over the whole frame.

    psnr, ssim: PSNR in dB (peak 1, which is white) and SSIM of each band.
    mean_psnr, mean_ssim: means over the bands.
    angle: mean spectral angle, degrees; NaN if the true cube is dark.
    truth: where the true cube is from, in words.
    """

    psnr: tuple[float, ...]
    ssim: tuple[float, ...]
    mean_psnr: float
    mean_ssim: float
    angle: float
    truth: str


@dataclass(frozen=True, eq=False)
class SpectralResult:
    """A spectral cube that was restored from a coded snapshot.

    Of large cubes, only every `pixel_step`-th row and column is sent.

    path: the record.
    source: the snapshot's name within the record.
    wavelengths: bands, m, rising.
    values: restored cube in shares of white, (bands, rows, columns).
    truth, error: true cube, and half width of the interval that holds the true value with a
        probability of 90 %, of the same shape; None where they aren't known.
    grey, true_grey: each band with the values of a screen, of the same shape; the second is None
        without a truth.
    snapshot: its bare pixels with the values of a screen, (rows, columns).
    maps: what is uncertain or wrong, the most telling one first.
    pixel_step: sensor pixels from one sent pixel to the next.
    colours: in the requested light.
    quality: scores against the true cube; None if it isn't known.
    white: what counts as white, in words.
    noise: standard deviation of a pixel's noise, electrons per second.
    iterations: of the solver.
    residual: the snapshot less the blurred cube, rms, over the noise.
    verdict: judgement of the residual, in words.
    notes: remarks for the person.
    cpu_seconds: processor time of the restoration.
    """

    path: Path
    source: str
    wavelengths: tuple[float, ...]
    values: NDArray[np.float32]
    truth: NDArray[np.float32] | None
    error: NDArray[np.float32] | None
    grey: Levels
    true_grey: Levels | None
    snapshot: Levels
    maps: tuple[BandMap, ...]
    pixel_step: int
    colours: CubeColours
    quality: CubeQuality | None
    white: str
    method: str
    noise: float
    iterations: int
    residual: float
    verdict: str
    notes: tuple[str, ...]
    cpu_seconds: float
