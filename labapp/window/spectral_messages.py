"""The messages about spectral cubes that the window and its engine exchange, in SI units.

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

    `bands` is what the person typed: wavelengths in nanometres, or "all". `light` names the CIE
    illuminant in which colours are shown.
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
    """Tell the window at which wavelengths, in metres, a record has the coded photograph.

    `decoder` names the design file whose decoder belongs to the coded pattern; empty without one.
    """

    path: Path
    wavelengths: tuple[float, ...]
    decoder: str = ""


@dataclass(frozen=True, eq=False)
class CubeColours:
    """Send the window the colours of a restored cube, and of the true one, in a light.

    Attributes
    ----------
    light : str
        Name of the light.
    restored : ndarray of uint8, shape (rows, columns, 3)
        The restored cube in sRGB.
    true : ndarray of uint8, of the same shape, or None
        The true cube in sRGB, if it is known.
    difference, largest_difference : float or None
        Mean CIEDE2000 over the whole frame, and its 95th percentile; None without a truth.
    """

    light: str
    restored: Levels
    true: Levels | None
    difference: float | None
    largest_difference: float | None


@dataclass(frozen=True, eq=False)
class BandMap:
    """Send the window a map of what is uncertain or wrong in each band of a cube.

    Attributes
    ----------
    title : str
        Title of the map.
    explanation : str
        What the map shows, in a sentence.
    caption : str
        What the map's values are, with their unit, in a few words.
    lowest, highest : float
        Values of the levels 0 and 255. A map whose lowest value is negative has 0 in the middle.
    levels : ndarray of uint8, shape (bands, rows, columns)
        The map of each band; a single one if it is that of all bands together.
    """

    title: str
    explanation: str
    caption: str
    lowest: float
    highest: float
    levels: Levels


@dataclass(frozen=True)
class CubeQuality:
    """Tell the window how far a restored cube is from the true one, over the whole frame.

    Attributes
    ----------
    psnr, ssim : tuple of float
        PSNR in dB (peak 1, which is white) and SSIM of each band.
    mean_psnr, mean_ssim : float
        Means over the bands.
    angle : float
        Mean spectral angle in degrees; NaN if the true cube is dark.
    truth : str
        Where the true cube is from, in words.
    """

    psnr: tuple[float, ...]
    ssim: tuple[float, ...]
    mean_psnr: float
    mean_ssim: float
    angle: float
    truth: str


@dataclass(frozen=True, eq=False)
class SpectralResult:
    """Send the window a spectral cube that was restored from a coded snapshot.

    Of large cubes, only every `pixel_step`-th row and column is sent.

    Attributes
    ----------
    path : Path
        The record.
    source : str
        The snapshot's name within the record.
    wavelengths : tuple of float
        Bands in metres, rising.
    values : ndarray of float32, shape (bands, rows, columns)
        The restored cube in shares of white.
    truth, error : ndarray of float32, of the same shape, or None
        The true cube, and the half width of the interval that holds the true value with a
        probability of 90 %; None where they aren't known.
    grey, true_grey : ndarray of uint8, of the same shape; the second may be None
        Each band with the values of a screen.
    snapshot : ndarray of uint8, shape (rows, columns)
        The snapshot's bare pixels with the values of a screen.
    maps : tuple of BandMap
        Maps of what is uncertain or wrong, the most telling one first.
    pixel_step : int
        Sensor pixels from one sent pixel to the next.
    colours : CubeColours
        The cube's colours in the requested light.
    quality : CubeQuality or None
        Scores against the true cube; None if it isn't known.
    white : str
        What counts as white, in words.
    method : str
        The restoration method.
    noise : float
        Standard deviation of a pixel's noise, in electrons per second.
    iterations : int
        Iterations of the solver.
    residual : float
        The snapshot less the blurred cube, rms, over the noise.
    verdict : str
        Judgement of the residual, in words.
    notes : tuple of str
        Remarks for the person.
    cpu_seconds : float
        Processor time of the restoration.
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
