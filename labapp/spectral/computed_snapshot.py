"""Coded snapshots that are computed from a known spectral cube, by convolutions alone.

They show what PSFs, noise and restoration allow, without a bench.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from labapp.files.reading import bundled_path
from labapp.files.sensor_file import read_sensor
from labapp.files.spectrum_file import read_spectra
from labapp.files.wavelengths import format_nanometres
from optics.inverse import build_mosaic_observation
from optics.inverse.mosaics import MosaicObservation
from optics.metrics import psnr
from optics.sensor import Mosaic

Picture = NDArray[np.float64]

_CHART_ROWS, _CHART_COLUMNS = 4, 6  # patches of a ColorChecker

# Width of the chart's black frame between two patches, over their distance; chosen.
_FRAME_SHARE = 0.16

_BLACK = 0.03  # reflectance of the chart's black frame, about that of its darkest patch; chosen


@dataclass(frozen=True, eq=False)
class ComputedSnapshot:
    """A photograph computed from a known spectral cube.

    truth: (bands, rows, columns), shares of white.
    observation: the raw picture with its PSFs, filters and noise.
    """

    truth: Picture
    observation: MosaicObservation

    def band_levels(self, bands: NDArray[np.floating]) -> tuple[float, ...]:
        """Return the PSNR in dB (peak 1) of each restored band, clipped to 0 to 1."""
        shown = np.clip(np.asarray(bands, dtype=np.float64), 0, 1)
        return tuple(psnr(one, wanted) for one, wanted in zip(shown, self.truth, strict=True))

    def mean_level(self, bands: NDArray[np.floating]) -> float:
        """Return the mean PSNR of the restored bands in dB."""
        return float(np.mean(self.band_levels(bands)))


def compute_snapshot(
    truth: Picture,
    psfs: NDArray[np.floating],
    mosaic: Mosaic,
    wavelengths: Sequence[float],
    *,
    noise: float,
    seed: int,
) -> ComputedSnapshot:
    """Compute the coded photograph of a spectral cube in the dark (thesis Eq. 4.2).

    Raises ValueError if no filter sees one of the bands, or PSFs and cube don't fit together.

    truth: (bands, rows, columns), shares of white, in bands at `wavelengths` (metres).
    psfs: (bands, rows, columns), origin at n // 2.
    noise: standard deviation of a pixel's Gaussian noise, relative to white; 0 or more.
    """
    shares = filter_shares(mosaic, wavelengths)
    letters = mosaic.channel_map((truth.shape[1], truth.shape[2])).numpy()
    raw = np.zeros(truth.shape[1:])
    for band, psf, share in zip(truth, psfs, shares.T, strict=True):
        raw += share[letters] * fftconvolve(band, psf, mode="same")
    raw += np.random.default_rng(seed).normal(0, noise, raw.shape)
    built = build_mosaic_observation(
        raw.astype(np.float32),
        mosaic.pattern,
        np.asarray(psfs, dtype=np.float32),
        channels="".join(mosaic.channels),
        response=shares.astype(np.float32),
        noise=noise,
        border="dark",
    )
    return ComputedSnapshot(truth, built)


def filter_shares(mosaic: Mosaic, wavelengths: Sequence[float]) -> NDArray[np.float64]:
    """Compute what each filter sees of each band (wavelengths in metres), (channels, bands).

    As in the program that was published with the thesis, the shares of a band sum to 1. So white
    gives as much light in all bands. Raises ValueError for a band that no filter sees.
    """
    curves = [mosaic.efficiencies[letter] for letter in mosaic.channels]
    seen = np.array([curve.at(np.asarray(wavelengths)) for curve in curves])
    light = seen.sum(0)
    if not (light > 0).all():
        dark = format_nanometres(wavelengths[int(np.argmin(light))])
        raise ValueError(f"no filter of the sensor sees the band at {dark}; leave it out")
    return np.asarray(seen / light)


def bundled_mosaic() -> Mosaic:
    """Read the colour filters of the thesis' camera, for work without a bench."""
    sensor = read_sensor("dvc-4000c-like", Path()).build()
    assert sensor.colour is not None
    return sensor.colour


def chart_cube(wavelengths: Sequence[float], side: int) -> Picture:
    """Draw a ColorChecker in a black frame from its patches' measured reflectances.

    The result is (bands, side, side); wavelengths are in metres.
    """
    chart = read_spectra(bundled_path("spectra") / "colorchecker.csv")
    patches = np.array([one.at(np.asarray(wavelengths)) for one in chart.values()])
    row, in_row = _patch_of_pixel(side, _CHART_ROWS)
    column, in_column = _patch_of_pixel(side, _CHART_COLUMNS)
    drawn = patches.T[:, row[:, None] * _CHART_COLUMNS + column]
    return np.where(in_row[:, None] & in_column, drawn, _BLACK)


def _patch_of_pixel(side: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the patch at each pixel of an axis, and whether the pixel is inside it."""
    place = (np.arange(side) + 0.5) / side * count
    index = place.astype(np.int64)
    return index, np.abs(place - index - 0.5) < 0.5 * (1 - _FRAME_SHARE)
