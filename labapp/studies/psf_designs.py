"""Study of the shapes of PSFs that tell spectral bands apart (thesis Tab. 4.1 and A.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure

from labapp.files.cubes import SpectralCube
from labapp.files.cubes.cube import SHARE_OF_WHITE
from labapp.files.plan_file import PlanFile, Reconstruction
from labapp.files.wavelengths import format_nanometres
from labapp.pictures.analysis.brackets import merge_all
from labapp.runs.record.reader import Record
from labapp.spectral.band_psfs import measure_band_psfs
from labapp.spectral.band_response import mosaic_of
from labapp.spectral.computed_snapshot import bundled_mosaic, chart_cube
from labapp.spectral.lights import find_light
from labapp.spectral.typical_spectra import typical_reflectances
from labapp.studies.catalogue.psf_designs import STUDY, PSFDesignSettings
from labapp.studies.coded_snapshots import psf_window, ring_table, star_blocks
from labapp.studies.contract import ResultRow, StudyFigure, StudyResults
from labapp.studies.design_judgement import (
    LINEAR,
    DesignResult,
    Stack,
    chart_snapshot,
    draw_designs,
    judge_design,
    longest_radius,
)
from labapp.studies.figure_drawing import draw_colours, draw_log
from labapp.studies.stars import build_study_plan, psf_pattern_table
from optics.camera import Camera
from optics.multispectral import restore_spectra, ring_psfs
from optics.plane import Plane
from optics.progress import Progress
from optics.sensor import Mosaic

PUBLISHED_POWER: Mapping[str, float] = {"ring": 20.2007, "dots": 7.6048, "spiral": 8.1108}
"""Dispersion power of the published PSFs (Table A.1)."""

PUBLISHED_PSNR: Mapping[str, float] = {"ring": 21.5473, "spiral": 22.0312, "dots": 22.2183}
"""Mean PSNR in dB of a ColorChecker with the real camera (Table 4.1)."""

_TWELVE = 12
_PUBLISHED_TWELVE = 35.4812
"""Mean PSNR in dB of twelve bands of a ColorChecker in the published simulation (Table A.2)."""


def plan(settings: PSFDesignSettings, camera: Camera) -> PlanFile:
    """Plan the star in all bands, without a pattern and with that of each shape."""
    patterns: dict[str, Any] = {}
    for shape in dict.fromkeys(settings.shapes):
        if shape == "ring":
            patterns[shape] = ring_table(settings)
        else:
            more = {"turns": settings.turns} if shape == "spiral" else {"count": settings.dots}
            table = psf_pattern_table(settings, shape, radius_um=settings.radius_um, **more)
            patterns[shape] = table
    return build_study_plan(STUDY, patterns, *star_blocks(settings, patterns))


def evaluate(record: Record, settings: PSFDesignSettings, progress: Progress) -> StudyResults:
    """Compare dispersion power, predicted quality and reached quality of the designs."""
    wavelengths = tuple(one * 1e-9 for one in settings.bands_nm)
    camera = record.camera
    mosaic = mosaic_of(record) or bundled_mosaic()
    measured = _measure_psfs(record, settings, wavelengths, progress.part(0, 0.2))
    drawn = draw_designs(settings, camera, wavelengths)
    stacks = {f"{name}, bench": one for name, one in measured.items()}
    stacks |= {f"{name}, drawn": one for name, one in drawn.items()}
    found = dict[str, DesignResult]()
    for number, (name, psfs) in enumerate(stacks.items()):
        start, stop = (0.2 + 0.6 * one / len(stacks) for one in (number, number + 1))
        part = progress.part(start, stop)
        found[name] = judge_design(psfs, wavelengths, mosaic, settings, part)
    rows = [*_power_rows(found, len(wavelengths)), *_level_rows(found)]
    if settings.twelve:
        rows.append(_twelve_row(settings, camera, mosaic, progress.part(0.8, 1)))
    notes = [
        "Snapshots are computed: a ColorChecker in the dark, "
        f"{settings.side_px} x {settings.side_px} pixels, with a noise of {settings.noise:g} of "
        "white. PSFs are known exactly, and all send the same light. The published ones of Table "
        "4.1 were taken by the real camera.",
        "Bench: PSFs as measured on the star, with unmodulated light and all else that the panel "
        f"does. Drawn: ideal ones of the same size, with {100 * settings.peak:g} % of the light in "
        "the middle.",
        "As printed, the dispersion power is large where PSFs of neighbouring bands differ "
        "little. Published values of 8 to 20 need PSFs that have nearly all of their light in "
        "common, such as a bright peak in the middle, or a background: the thesis doesn't say "
        "which window and which scale they are of.",
        "The thesis finds linear dispersion hardly usable. That isn't so here, where PSFs are "
        "exactly known and the prior knows typical spectra. The chart has many edges across the "
        "dispersion, which show how far each band is moved.",
        "Expected is a prediction from PSFs, filters and noise alone, for usual scenes. A "
        "chart may differ from it by several decibels, but alike for all designs.",
    ]
    figures = [_colours_figure(found, wavelengths, settings), _psfs_figure(found, wavelengths)]
    data = {
        name: {
            "dispersion_power": one.power,
            "mean_mtf": one.coverage,
            "predicted_psnr_db": one.predicted,
            "psnr_db": list(one.levels),
        }
        for name, one in found.items()
    }
    return StudyResults(rows, figures, notes, data)


def _measure_psfs(
    record: Record,
    settings: PSFDesignSettings,
    wavelengths: Sequence[float],
    progress: Progress,
) -> dict[str, Stack]:
    """Measure the PSFs of each pattern on the star, each of sum 1."""
    brackets = merge_all(record, progress, {"star"})
    window, found = psf_window(settings, record.camera), dict[str, Stack]()
    for shape in dict.fromkeys(settings.shapes):
        roles = Reconstruction(coded=shape, psf_window_px=window)
        found[shape] = measure_band_psfs(record, brackets, roles, wavelengths).with_unit_sums().psfs
    return found


def _power_rows(found: Mapping[str, DesignResult], bands: int) -> list[ResultRow]:
    """Return the rows with the dispersion power of each design."""
    least = f"at least {(bands - 2) / (4 * bands):.2f}, where PSFs don't overlap"
    return [
        ResultRow(
            f"dispersion power (Eq. A.1), {name}",
            _format_published(PUBLISHED_POWER, name, "{:.1f} (Table A.1)"),
            least,
            f"{one.power:.2f}",
            one.power,
        )
        for name, one in found.items()
        if one.power is not None
    ]


def _level_rows(found: Mapping[str, DesignResult]) -> list[ResultRow]:
    """Return the rows with the quality of each design."""
    return [
        ResultRow(
            f"mean PSNR of the bands, {name}",
            "hardly usable (Fig. 4.11, no number)"
            if name.startswith(LINEAR)
            else _format_published(PUBLISHED_PSNR, name, "{:.1f} dB (Table 4.1)"),
            f"{one.predicted:.1f} dB predicted",
            f"{one.mean_level:.1f} dB, {min(one.levels):.1f} to {max(one.levels):.1f}",
            one.mean_level,
        )
        for name, one in found.items()
    ]


def _format_published(numbers: Mapping[str, float], name: str, words: str) -> str:
    """Return a published number of a design in words."""
    number = numbers.get(name.split(",")[0])
    return "-" if number is None else words.format(number)


def _twelve_row(
    settings: PSFDesignSettings, camera: Camera, mosaic: Mosaic, progress: Progress
) -> ResultRow:
    """Restore twelve bands of a chart, with rings and without noise."""
    nm = np.linspace(min(settings.bands_nm), max(settings.bands_nm), _TWELVE)
    wavelengths = tuple((nm * 1e-9).tolist())
    pitch, window = camera.sensor.pitch, psf_window(settings, camera)
    plane, radius = Plane((window, window), (pitch, pitch)), longest_radius(settings)
    psfs = ring_psfs(plane, wavelengths, radius, unmodulated=settings.peak).numpy()
    snapshot = chart_snapshot(psfs, wavelengths, mosaic, settings.side_px, 0.0)
    spectra = torch.from_numpy(typical_reflectances(wavelengths))
    restored = restore_spectra(snapshot.observation, spectra, progress=progress)
    level = snapshot.mean_level(np.asarray(restored.image))
    return ResultRow(
        "mean PSNR of twelve bands, ring, drawn, without noise",
        f"{_PUBLISHED_TWELVE:.1f} dB (Table A.2, ColorChecker)",
        "-",
        f"{level:.1f} dB",
        level,
    )


def _colours_figure(
    found: Mapping[str, DesignResult], wavelengths: tuple[float, ...], settings: PSFDesignSettings
) -> StudyFigure:
    """Draw the colours of the chart that each design restores."""
    light = find_light("D65")
    pictures = {"true": chart_cube(wavelengths, settings.side_px)} | {
        f"{name}, {one.mean_level:.1f} dB": one.bands for name, one in found.items()
    }
    columns = 4
    rows = -(-len(pictures) // columns)
    figure = Figure(figsize=(3.6 * columns, 3.8 * rows), dpi=100, layout="constrained")
    all_axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (name, bands) in zip(all_axes, pictures.items(), strict=False):
        cube = SpectralCube(bands.astype(np.float32), wavelengths, SHARE_OF_WHITE)
        draw_colours(axes, cube, light, name)
    for axes in all_axes[len(pictures) :]:
        axes.set_axis_off()
    return StudyFigure("Restored charts", figure, "Fig. 4.10 and 4.11: colours in D65.")


def _psfs_figure(found: Mapping[str, DesignResult], wavelengths: tuple[float, ...]) -> StudyFigure:
    """Draw the PSFs of designs, a row for each design and a column for each band."""
    rows, count = len(found), len(wavelengths)
    figure = Figure(figsize=(2.2 * count, 2.4 * rows), dpi=100, layout="constrained")
    axes = figure.subplots(rows, count, squeeze=False)
    for row, (name, result) in zip(axes, found.items(), strict=True):
        peak = float(result.psfs.max())
        for one, psf, wavelength in zip(row, result.psfs, wavelengths, strict=True):
            draw_log(one, psf, f"{name}, {format_nanometres(wavelength)}", peak)
    return StudyFigure(
        "PSFs", figure, "Fig. 4.4 and Fig. A.1 to A.3, 4 decades below the design's peak."
    )
