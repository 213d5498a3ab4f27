"""Plans with an artificial star, and the PSFs that are measured on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from labapp.files.plan_file import PlanFile, Reconstruction
from labapp.files.reading import validate
from labapp.pictures.analysis.brackets import Picture, find_bracket, merge_all
from labapp.pictures.analysis.star_psf import PSFReport, bright_centroid, crop_centred, measure_psf
from labapp.runs.record.reader import Record
from labapp.studies.contract import Study
from optics.progress import Progress


def build_study_plan(
    study: Study[Any], patterns: Mapping[str, Any], *blocks: Mapping[str, Any], **more: Any
) -> PlanFile:
    """Build a plan; the pattern "neutral" is added to the study's own patterns."""
    data = {
        "version": 1,
        "title": study.title,
        "patterns": {"neutral": {"kind": "constant", "grey": 0}, **patterns},
        "acquire": blocks,
    }
    return validate(data | more, PlanFile, f"study {study.title!r}")


def psf_pattern_table(settings: Any, shape: str, **sizes: Any) -> dict[str, Any]:
    """Return the plan table of a pattern whose PSF has a shape, from the settings."""
    return {
        "kind": "psf",
        "target": {"shape": shape, "width_um": settings.width_um, **sizes},
        "wavelength_nm": settings.wavelength_nm,
        "iterations": settings.iterations,
    }


def acquisition_block(
    targets: Sequence[str], patterns: Sequence[str], wavelength_nm: float, **exposures: Any
) -> dict[str, Any]:
    """Return a plan block of targets with each pattern, after dark frames.

    There are dark frames of every exposure.

    `exposures` is `exposures_ms`, or `periods` of videos, as in a block of a plan file.
    """
    return {
        **exposures,
        "targets": targets,
        "patterns": patterns,
        "wavelengths_nm": [wavelength_nm],
        "interleave": [{"role": "dark", "frames": 4}],
    }


def measure_psfs(
    record: Record,
    patterns: Sequence[str],
    wavelength_nm: float,
    window_px: int,
    progress: Progress,
) -> dict[str, PSFReport]:
    """Measure every pattern's PSF on a star, which was also taken with "neutral"."""
    brackets = merge_all(record, progress.part(0, 0.3))
    found = {}
    for number, name in enumerate(patterns):
        progress.report(0.3 + 0.7 * number / len(patterns), f"PSF of {name}")
        roles = Reconstruction(coded=name, wavelength_nm=wavelength_nm, psf_window_px=window_px)
        found[name] = measure_psf(record, brackets, roles)
    return found


def psf_noise_variances(
    record: Record,
    patterns: Sequence[str],
    wavelength_nm: float,
    window_px: int,
    progress: Progress,
) -> dict[str, float]:
    """Return the noise variance of each measured PSF, summed over its window.

    It is what the camera's noise adds to a squared difference of PSFs, in units of the squared
    light of the neutral star.
    """
    brackets = merge_all(record, progress)
    metres = wavelength_nm * 1e-9
    neutral = find_bracket(brackets, "star", "neutral", metres, record.path).rate
    centre = bright_centroid(neutral)
    total = float(crop_centred(neutral, centre, window_px).sum())
    found = {}
    for name in patterns:
        variance = find_bracket(brackets, "star", name, metres, record.path).variance
        known = np.where(np.isfinite(variance), variance, 0.0)
        found[name] = float(crop_centred(known, centre, window_px).sum()) / total**2
    return found


def requested_psf(report: PSFReport) -> Picture:
    """Return the PSF that a pattern was made for; psf_pattern_table() gives one to each."""
    assert report.target is not None
    return report.target


def correlation(one: Picture, other: Picture) -> float:
    """Return Pearson's correlation coefficient of two pictures."""
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])
