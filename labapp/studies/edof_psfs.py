"""Measured PSFs over depth beside simulated ones, behind patterns for extended depth of field."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from labapp.files.plan_file import Reconstruction
from labapp.pictures.analysis.brackets import Bracket, Picture, find_bracket
from labapp.pictures.analysis.star_psf import bright_centroid, crop_centred, measure_psf
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.edof import EdofSettings
from labapp.studies.edof_pattern import NEUTRAL
from optics.progress import Progress

MOST_SHIFT = 1.0
"""Pixels along each axis by which a measured PSF may be moved onto the simulated one. The star's
place is known to a pixel."""


@dataclass(frozen=True, eq=False)
class ComparedPSF:
    """Hold a measured PSF beside the simulated one, both as shares of the star's light.

    The light is that without a pattern.
    measured, simulated: (rows, columns); `simulated` is moved by `shift`.
    shift: pixels (y, x) by which the simulated PSF is moved, at most MOST_SHIFT.
    difference: relative L2 distance of the two.
    noise: the part of the difference that the camera's noise makes, as expected from its variance.
    """

    measured: Picture
    simulated: Picture
    shift: tuple[float, float]
    difference: float
    noise: float

    @property
    def beside_noise(self) -> float:
        """The difference without the part that noise makes."""
        return math.sqrt(max(self.difference**2 - self.noise**2, 0.0))


PSFs = Mapping[tuple[str, float], ComparedPSF]
"""Compared PSFs by pattern and distance in metres."""


def star_name(distance: float) -> str:
    """Return the target name of the star at a distance in metres."""
    return f"star-{distance * 100:.0f}cm"


def compare_psfs(
    record: Record,
    brackets: list[Bracket],
    patterns: Sequence[str],
    settings: EdofSettings,
    progress: Progress,
) -> dict[tuple[str, float], ComparedPSF]:
    """Compare the PSFs of patterns at all distances with simulated ones.

    Raises UserError if the record doesn't describe its stars.
    """
    wanted = [(name, distance) for name in patterns for distance in settings.distances_m]
    nm, window, found = settings.wavelength_nm, settings.psf_px, {}
    for number, (name, distance) in enumerate(wanted):
        progress.report(number / len(wanted), f"PSF of {name}, {distance:g} m")
        roles = Reconstruction(
            star=star_name(distance), coded=name, wavelength_nm=nm, psf_window_px=window
        )
        report = measure_psf(record, brackets, roles)
        simulated = report.measured if report.predicted is None else report.predicted
        shift = fit_shift(report.measured, simulated)
        moved = move_picture(simulated, shift)
        difference = float(np.linalg.norm(report.measured - moved) / np.linalg.norm(moved))
        noise = _noise_norm(record, brackets, roles) / float(np.linalg.norm(moved))
        found[name, distance] = ComparedPSF(report.measured, moved, shift, difference, noise)
    return found


def _noise_norm(record: Record, brackets: list[Bracket], roles: Reconstruction) -> float:
    """Return the L2 norm that noise has on average in a measured PSF."""
    neutral, coded = (
        find_bracket(brackets, roles.star, pattern, roles.wavelength, record.path)
        for pattern in (NEUTRAL, roles.coded)
    )
    window = min(roles.psf_window_px, *neutral.rate.shape)
    centre = bright_centroid(neutral.rate)
    variance = crop_centred(coded.variance, centre, window)
    total = float(crop_centred(neutral.rate, centre, window).sum())
    return math.sqrt(float(variance[np.isfinite(variance)].sum())) / total


def fit_shift(measured: Picture, simulated: Picture) -> tuple[float, float]:
    """Fit the shift (y, x) in pixels that moves a simulated PSF onto the measured one.

    It is at most MOST_SHIFT along each axis, and the one of the least squared difference.
    """
    spectrum, wanted = np.fft.rfft2(simulated), np.fft.rfft2(measured)
    product = wanted * spectrum.conj()
    # The other half of the frequencies adds as much, but for those that are their own mirror image.
    product[:, 1 : (simulated.shape[1] + 1) // 2] *= 2
    fy, fx = _frequencies(simulated.shape)
    scale = float(np.abs(product).sum()) or 1.0

    def unlike(shift: NDArray[np.float64]) -> float:
        """Return the negative correlation; the other terms don't depend on the shift."""
        turned = product * np.exp(2j * np.pi * (fy * shift[0] + fx * shift[1]))
        return -float(turned.real.sum()) / scale

    best = minimize(unlike, np.zeros(2), bounds=[(-MOST_SHIFT, MOST_SHIFT)] * 2)
    return float(best.x[0]), float(best.x[1])


def move_picture(picture: Picture, shift: tuple[float, float]) -> Picture:
    """Move a picture by a shift (y, x) in pixels, as a periodic Fourier series."""
    fy, fx = _frequencies(picture.shape)
    turn = np.exp(-2j * np.pi * (fy * shift[0] + fx * shift[1]))
    return np.asarray(np.fft.irfft2(np.fft.rfft2(picture) * turn, picture.shape))


def _frequencies(shape: tuple[int, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the frequencies (y, x) of the grid of rfft2, cycles per pixel."""
    down, along = np.fft.fftfreq(shape[0]), np.fft.rfftfreq(shape[1])
    return np.asarray(down[:, None], np.float64), np.asarray(along[None, :], np.float64)


def likeness_over_depth(psfs: PSFs, name: str) -> float:
    """Return the mean correlation of measured PSFs with their mean over depth."""
    stack = [one.measured.ravel() for (pattern, _), one in psfs.items() if pattern == name]
    mean = np.mean(stack, axis=0)
    cosines = [one @ mean / (np.linalg.norm(one) * np.linalg.norm(mean)) for one in stack]
    return float(np.mean(cosines))
