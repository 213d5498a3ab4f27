"""Study of multispectral imaging from one coded photograph on a bench (thesis section 4.5)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from labapp.files.plan_file import PlanFile
from labapp.files.wavelengths import format_nanometres
from labapp.runs.record.reader import Record
from labapp.spectral.lights import ViewingLight, find_light
from labapp.spectral.problem import WHITE_PERCENTILE, SpectralProblem
from labapp.spectral.restoration import RestoredCube, restore_snapshot
from labapp.spectral.scores import CubeScores
from labapp.studies.catalogue.multispectral import STUDY, MultispectralSettings
from labapp.studies.coded_snapshots import plan_snapshot, read_problem
from labapp.studies.contract import ResultRow, StudyFigure, StudyResults
from labapp.studies.figure_drawing import draw_colours, draw_log, draw_photograph
from optics.camera import Camera
from optics.progress import Progress

PUBLISHED_BANDS = {450: 27.6, 500: 28.9, 550: 28.6, 600: 28.4, 650: 26.7, 700: 24.9}
"""PSNR in dB by band in nanometres of the published simulation with flowers (Fig. 4.7)."""

PUBLISHED_MEAN = 21.5473
"""Mean PSNR in dB of the ColorChecker with the real camera and a ring (Table 4.1)."""


def plan(settings: MultispectralSettings, camera: Camera) -> PlanFile:
    """Plan star, scene and white sheet in all bands, without and with the ring."""
    # A light that isn't known is refused before anything is acquired.
    find_light(settings.light)
    return plan_snapshot(STUDY, settings, camera)


def evaluate(record: Record, settings: MultispectralSettings, progress: Progress) -> StudyResults:
    """Restore all bands of the snapshot, and compare them with the truth."""
    light = find_light(settings.light)
    problem = read_problem(record, progress.part(0, 0.4))
    restored = restore_snapshot(problem, light, progress=progress.part(0.4, 0.95))
    assert restored.scores is not None
    figures = [_overview_figure(problem, restored, light), _bands_figure(problem, restored)]
    notes = [
        "PSNR (peak 1, which is white) and SSIM (range 1) are over the whole frame, against the "
        "photographs without a pattern. Those are demosaiced pictures of one colour: a quarter or "
        "half of their pixels saw anything, and their noise counts as error.",
        "Fig. 4.7 is a simulation with another scene and without noise. The ColorChecker of Table "
        "4.1 has 805 x 805 pixels. So the published numbers are comparable only in their size.",
        f"The restoration's verdict: {restored.verdict}. Its weight was chosen from the snapshot.",
        *(f"{one[0].upper()}{one[1:]}." for one in problem.notes),
    ]
    data = {"scores": restored.scores.as_data, "residual": restored.image.residual}
    return StudyResults(_rows(problem, restored, restored.scores), figures, notes, data)


def _rows(
    problem: SpectralProblem, restored: RestoredCube, scores: CubeScores
) -> Sequence[ResultRow]:
    """Return the table's rows: each band, their mean, and the colours."""
    rows = [
        ResultRow(
            f"band at {format_nanometres(wavelength)}",
            _published_band(wavelength),
            "-",
            f"{one.psnr:.1f} dB, SSIM {one.ssim:.3f}",
            one.psnr,
        )
        for wavelength, one in zip(problem.wavelengths, scores.bands, strict=True)
    ]
    return [
        *rows,
        ResultRow(
            "mean PSNR of the bands",
            f"{PUBLISHED_MEAN:.1f} dB with the real camera (Table 4.1, ColorChecker, ring)",
            "-",
            f"{scores.psnr:.1f} dB",
            scores.psnr,
        ),
        ResultRow("mean SSIM of the bands", "-", "-", f"{scores.ssim:.3f}", _finite(scores.ssim)),
        ResultRow(
            "spectral angle, mean of pixels that aren't dark",
            "-",
            "-",
            f"{scores.angle:.1f}°",
            _finite(scores.angle),
        ),
        ResultRow(
            f"colour difference in {scores.light}, CIEDE2000",
            "picture only (Fig. 4.8)",
            "about 1 is just visible",
            f"{scores.difference:.1f} mean, {scores.largest_difference:.1f} at 95 % of the pixels",
            scores.difference,
        ),
        ResultRow(
            "what the bands leave unexplained of the snapshot, over its noise",
            "-",
            "about 1",
            f"{restored.image.residual:.2f}",
            restored.image.residual,
        ),
    ]


def _published_band(wavelength: float) -> str:
    """Return the published PSNR of a band in words.

    wavelength: metres.
    """
    level = PUBLISHED_BANDS.get(round(wavelength * 1e9))
    return "-" if level is None else f"{level:g} dB in a simulation (Fig. 4.7)"


def _finite(value: float) -> float | None:
    """Return a score, or None for one that isn't known."""
    return value if math.isfinite(value) else None


def _overview_figure(
    problem: SpectralProblem, restored: RestoredCube, light: ViewingLight
) -> StudyFigure:
    """Draw the snapshot beside the colours of the restored and of the true cube."""
    figure = Figure(figsize=(16, 4.4), dpi=100, layout="constrained")
    axes = figure.subplots(1, 3)
    rate = np.nan_to_num(problem.rate)
    bright = float(np.percentile(rate, WHITE_PERCENTILE))
    draw_photograph(axes[0], rate, "snapshot, bare pixels", max(bright, 1e-300))
    apart = "" if restored.scores is None else f", CIEDE2000 {restored.scores.difference:.1f}"
    draw_colours(axes[1], restored.cube, light, f"restored{apart}")
    if restored.truth is not None:
        draw_colours(axes[2], restored.truth, light, "true")
    return StudyFigure(
        "Snapshot and colours",
        figure,
        f"Fig. 4.8 (m) to (o): colours of the bands in {light.name}, adapted to it.",
    )


def _bands_figure(problem: SpectralProblem, restored: RestoredCube) -> StudyFigure:
    """Draw each restored band beside the true one, with the PSFs below."""
    count = len(problem.wavelengths)
    figure = Figure(figsize=(2.7 * max(count, 3), 6.4), dpi=100, layout="constrained")
    columns = figure.subplots(3, count, squeeze=False).T
    for band, axes in enumerate(columns):
        level = "" if restored.scores is None else f", {restored.scores.bands[band].psnr:.1f} dB"
        name = format_nanometres(problem.wavelengths[band])
        draw_photograph(axes[0], restored.cube.values[band], f"{name}{level}", 1.0)
        if restored.truth is not None:
            draw_photograph(axes[1], restored.truth.values[band], "true", 1.0)
        draw_log(axes[2], problem.psfs[band], "PSF, 4 decades")
    return StudyFigure("Bands", figure, "Fig. 4.3 (c) to (h), and Fig. 4.8 (a) to (l).")
