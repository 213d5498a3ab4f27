"""Study of the smoothness of a PSF that is averaged over a phase video (thesis Fig. 3.5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from labapp.files.plan_file import PlanFile
from labapp.pictures.analysis.star_psf import PSFReport
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.psf_stability import STUDY, StabilitySettings
from labapp.studies.contract import ResultRow, StudyFigure, StudyResults
from labapp.studies.figure_drawing import draw_linear
from labapp.studies.stars import (
    acquisition_block,
    build_study_plan,
    measure_psfs,
    psf_noise_variances,
    psf_pattern_table,
    requested_psf,
)
from optics import metrics
from optics.camera import Camera
from optics.progress import Progress


def plan(settings: StabilitySettings, camera: Camera) -> PlanFile:
    """Plan an exposure of about a second for each video and for a still pattern.

    An exposure lasts whole periods of its video.
    """
    still = psf_pattern_table(settings, "spiral", radius_um=settings.radius_um)
    lengths = _frames_by_pattern(settings)
    # All videos have one seed, so that a shorter video is the beginning of a longer one.
    nm, patterns = settings.wavelength_nm, {}
    blocks = [acquisition_block(["star"], ["neutral"], nm, exposures_ms=settings.neutral_ms)]
    for name, count in lengths.items():
        frame = still | {"method": "joint" if name == "joint" else "independent"}
        video = {"kind": "video", "pattern": frame, "count": count}
        patterns[name] = frame if count == 1 else video
        # The thesis' panel shows 60 frames per second, so the exposures last about a second.
        periods = {"periods": [max(1, round(60 / count))]}
        exposures = periods if count > 1 else {"exposures_ms": [1000.0]}
        blocks.append(acquisition_block(["star"], [name], nm, **exposures))
    return build_study_plan(STUDY, patterns, *blocks)


def _frames_by_pattern(settings: StabilitySettings) -> dict[str, int]:
    """Return the number of frames of each video; the reference is last but one."""
    counts = {f"frames-{count}": count for count in sorted(set(settings.counts))}
    return counts | {"reference": settings.reference, "joint": settings.joint}


@dataclass(frozen=True)
class AveragedVideo:
    """Hold the measured error and speckle contrast of a PSF averaged over a video's frames.

    error: mean square difference from the reference over the reference's mean square, without the
    part that the camera's noise contributes.
    """

    frames: int
    error: float
    contrast: float


def evaluate(record: Record, settings: StabilitySettings, progress: Progress) -> StudyResults:
    """Compare errors against the longest video with the law of speckle."""
    names, window_px = list(_frames_by_pattern(settings)), 96
    found = measure_psfs(record, names, settings.wavelength_nm, window_px, progress.part(0, 0.8))
    noise = psf_noise_variances(
        record, names, settings.wavelength_nm, window_px, progress.part(0.8, 1)
    )
    truth = found["reference"].modulated_psf
    size = float((truth**2).sum())
    averaged = []
    for count in sorted(set(settings.counts)):
        name = f"frames-{count}"
        raw = float(((found[name].modulated_psf - truth) ** 2).sum())
        error = (raw - noise[name] - noise["reference"]) / size
        averaged.append(AveragedVideo(count, error, _speckle_contrast(found[name])))
    rows = [*_error_rows(averaged, settings), *_smoothness_rows(found, averaged, settings)]
    notes = [
        "A video of n frames is the beginning of the reference of N frames. Frames from "
        "independent random starts have independent speckle, so that the expected error is "
        "proportional to 1/n - 1/N (variance of a mean; Goodman, Speckle Phenomena in Optics, "
        "2007, section 5). Exposures last about a second, in whole periods of each video; the "
        "camera's noise, as the brackets know it, is taken off.",
        "Frames that are found together, each knowing of the others, aren't in the thesis; "
        "they need far fewer frames.",
    ]
    data = {"averaged": [vars(one) for one in averaged], "noise": noise}
    return StudyResults(rows, [_errors_figure(found, averaged, settings)], notes, data)


def _speckle_contrast(report: PSFReport) -> float:
    noise = report.variance_without(report.unmodulated)
    return metrics.speckle_contrast(report.modulated_psf, requested_psf(report), noise)


def independent_frames_error(frames: int, reference: int) -> float:
    """Return the expected error of the mean of a video's first frames.

    The frames are taken to be independent. The error is relative to that of one frame against a
    reference of infinitely many frames, and follows from the variance of a mean.
    """
    return 1 / frames - 1 / reference


def _error_rows(averaged: Sequence[AveragedVideo], settings: StabilitySettings) -> list[ResultRow]:
    first = averaged[0]
    whole = independent_frames_error(first.frames, settings.reference)
    rows = [
        ResultRow(
            f"error of {_frames(first.frames)} against {settings.reference}, mean square",
            "curve only",
            "-",
            f"{first.error:.3f}",
            first.error,
        )
    ]
    for one in averaged[1:]:
        share = one.error / first.error
        rows.append(
            ResultRow(
                f"error of {_frames(one.frames)} over that of {_frames(first.frames)}",
                "decreases quickly, levels off at 30 of 60" if one is averaged[-1] else "",
                f"{independent_frames_error(one.frames, settings.reference) / whole:.3f}",
                f"{share:.3f}",
                share,
            )
        )
    return rows


def _smoothness_rows(
    found: Mapping[str, PSFReport], averaged: Sequence[AveragedVideo], settings: StabilitySettings
) -> list[ResultRow]:
    first = averaged[0]
    long, together = _speckle_contrast(found["reference"]), _speckle_contrast(found["joint"])
    root = first.contrast * (first.frames / settings.reference) ** 0.5
    return [
        ResultRow(
            f"speckle contrast of {_frames(first.frames)}",
            "unwanted discontinuities (no number)",
            "-",
            f"{first.contrast:.2f}",
            first.contrast,
        ),
        ResultRow(
            f"speckle contrast of {settings.reference} independent frames",
            "much improved smoothness (no number)",
            f"{root:.3f} or more: 1/√n",
            f"{long:.3f}",
            long,
        ),
        ResultRow(
            f"speckle contrast of {settings.joint} frames found together",
            "not in the thesis",
            "-",
            f"{together:.3f}",
            together,
        ),
    ]


def _frames(count: int) -> str:
    return "one frame" if count == 1 else f"{count} frames"


def _errors_figure(
    found: Mapping[str, PSFReport], averaged: Sequence[AveragedVideo], settings: StabilitySettings
) -> StudyFigure:
    figure = Figure(figsize=(13, 9), dpi=100, layout="constrained")
    top, bottom = np.asarray(figure.subfigures(2, 1, height_ratios=[1, 1.05]))
    first = averaged[0]
    pictures = {
        f"(a) {_frames(first.frames)}": found[f"frames-{first.frames}"].modulated_psf,
        f"(b) {settings.reference} independent frames": found["reference"].modulated_psf,
        f"{settings.joint} frames found together": found["joint"].modulated_psf,
    }
    white = 1.3 * float(np.percentile(found["reference"].modulated_psf, 99.8))
    for one, (title, picture) in zip(top.subplots(1, 3), pictures.items(), strict=True):
        draw_linear(one, picture, title, white)
    axes = bottom.subplots()
    scale = first.error / independent_frames_error(first.frames, settings.reference)
    n = np.linspace(1, settings.reference, 400)
    curve = scale * (1 / n - 1 / settings.reference)
    axes.semilogy(n[:-1], curve[:-1], "-", color="0.6", label="law: 1/n - 1/N, through the first")
    axes.semilogy([a.frames for a in averaged], [a.error for a in averaged], "o", label="measured")
    axes.set_ylim(min(curve[-40], *(a.error for a in averaged if a.error > 0)) / 2, None)
    axes.set_xlabel("frames averaged")
    axes.set_ylabel(f"mean square error against {settings.reference} frames, relative")
    axes.set_title("(c) Error by the number of frames")
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    return StudyFigure(
        "PSFs and their error",
        figure,
        "Unmodulated light removed; one linear scale for the three. Below, Fig. 3.5 (c): the error "
        "against the longest video.",
    )
