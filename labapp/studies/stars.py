"""What studies of PSFs share: plans that take an artificial star, and its PSF by pattern."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from labapp.files.plan_file import Reconstruction
from labapp.pictures.analysis.brackets import Picture, find, merge_all
from labapp.pictures.analysis.star import PSFReport, centre_of, cut, measure_psf
from labapp.runs.record.reader import Record
from optics.progress import Progress

NEUTRAL: Mapping[str, Any] = {"kind": "constant", "grey": 0}


def star_blocks(
    patterns: Sequence[str], wavelength_nm: float, exposures_ms: Sequence[float], darks: int = 4
) -> list[dict[str, Any]]:
    """A bracket of the star with each pattern, after dark frames of every exposure."""
    block = {
        "targets": ["star"],
        "patterns": list(patterns),
        "wavelengths_nm": [wavelength_nm],
        "exposures_ms": list(exposures_ms),
        "interleave": [{"role": "dark", "frames": darks}],
    }
    return [block]


def measured_psfs(
    record: Record,
    patterns: Sequence[str],
    wavelength_nm: float,
    window_px: int,
    progress: Progress,
) -> dict[str, PSFReport]:
    """The PSF of every pattern, by the star that was also taken with the pattern "neutral"."""
    brackets = merge_all(record, record.plan, progress.part(0, 0.3))
    found = {}
    for number, name in enumerate(patterns):
        progress.report(0.3 + 0.7 * number / len(patterns), f"PSF of {name}")
        roles = Reconstruction(coded=name, wavelength_nm=wavelength_nm, psf_window_px=window_px)
        found[name] = measure_psf(record, brackets, roles)
    return found


def summed_noise(
    record: Record,
    patterns: Sequence[str],
    wavelength_nm: float,
    window_px: int,
    progress: Progress,
) -> dict[str, float]:
    """Variance of each measured PSF, summed over its window: what the camera's noise adds to the
    square of a difference, on the scale of the neutral star's light."""
    brackets = merge_all(record, record.plan, progress)
    metres = wavelength_nm * 1e-9
    neutral = find(brackets, "star", "neutral", metres, record.path).rate
    centre = centre_of(neutral)
    total = float(cut(neutral, centre, window_px).sum())
    found = {}
    for name in patterns:
        variance = find(brackets, "star", name, metres, record.path).variance
        known = np.where(np.isfinite(variance), variance, 0.0)
        found[name] = float(cut(known, centre, window_px).sum()) / total**2
    return found


def correlation(one: Picture, other: Picture) -> float:
    """Pearson's coefficient of two pictures."""
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])
