"""Study of PSFs of many shapes, measured on a bench (thesis Fig. 3.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.files.picture.grey_picture import read_grey_picture
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled_path
from labapp.pictures.analysis.brackets import Picture
from labapp.pictures.analysis.star_psf import PSFReport
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.psf_shapes import PUBLISHED_SHAPES, STUDY, Shape, ShapesSettings
from labapp.studies.contract import ResultRow, StudyFigure, StudyResults
from labapp.studies.figure_drawing import draw_linear, draw_log
from labapp.studies.stars import (
    acquisition_block,
    build_study_plan,
    correlation,
    measure_psfs,
    psf_pattern_table,
    requested_psf,
)
from optics import metrics
from optics.camera import Camera
from optics.progress import Progress

RING_RADIUS_SAMPLES, _RING_WIDTH_SAMPLES = 30, 1.15
"""Radius and width (standard deviation) of the published ring, in samples of its PSF."""

_SIDE = 1920 * 8e-6
"""Side of the authors' panel in metres, which is also that of the square that they transform."""

RING_BAND = (20, 40)
"""Distances from the axis, in samples, between which the published ring's light is summed."""

RING_ENERGY: Mapping[int, float] = {1: 0.780, 10: 0.849, 100: 0.903, 569: 0.933}
"""Share of the light within the band by the number of iterations, for the published patterns.

Their PSFs are computed as the authors do it, by one Fourier transform of the pattern within
1920 x 1920 samples.
"""


def published_ring_sizes(camera: Camera, wavelength: float) -> tuple[float, float]:
    """Return the radius and width of the published ring on the sensor, in metres.

    The width is the ring's standard deviation. A sample of the published transform is wavelength x
    image distance / 15.36 mm. On a bench, B of the ray matrix takes the place of the image
    distance.
    """
    sample = wavelength * camera.ray_matrix_b / _SIDE
    return RING_RADIUS_SAMPLES * sample, _RING_WIDTH_SAMPLES * sample


def read_published_ring() -> NDArray[np.uint8]:
    """Read the middle of the thesis' ring after 569 iterations, 100 x 100 samples."""
    return read_grey_picture(bundled_path("studies/published-ring.png"), "a pattern")


def plan(settings: ShapesSettings, camera: Camera) -> PlanFile:
    """Plan the star with the neutral pattern, and with a pattern for each shape."""
    shapes = dict.fromkeys(settings.shapes)
    names = ["neutral", *shapes]
    return build_study_plan(
        STUDY,
        {
            shape: psf_pattern_table(settings, shape, **_sizes(shape, settings, camera))
            for shape in shapes
        },
        acquisition_block(
            ["star"], names, settings.wavelength_nm, exposures_ms=settings.exposures_ms
        ),
    )


def _sizes(shape: Shape, settings: ShapesSettings, camera: Camera) -> dict[str, Any]:
    if shape == "letters":
        return {"text": settings.text, "height_um": 1.4 * settings.radius_um}
    if shape == "ring":
        radius, width = published_ring_sizes(camera, settings.wavelength_nm * 1e-9)
        return {"radius_um": radius * 1e6, "width_um": width * 1e6}
    return {"radius_um": settings.radius_um}


def evaluate(record: Record, settings: ShapesSettings, progress: Progress) -> StudyResults:
    """Compare the light within each shape, correlation and speckle contrast with predictions."""
    shapes = list(dict.fromkeys(settings.shapes))
    found = measure_psfs(record, shapes, settings.wavelength_nm, window_px=128, progress=progress)
    rows = [_row(shape, report) for shape, report in found.items()]
    camera = record.camera
    first = next(iter(found.values())).unmodulated
    rows.append(
        ResultRow(
            "light that no pattern moves, in the central peak",
            "a prominent central peak (no number)",
            f"{_format_percent(camera.panel.unmodulated)} (bench file)",
            _format_percent(first),
            first,
        )
    )
    plates = [_overview(record, found)]
    if "ring" in found:
        rows.append(_ring_row(found["ring"], camera, settings))
        plates.append(_ring_figure(found["ring"], camera, settings))
    notes = [
        "Light within a shape is where the target exceeds 2 % of its peak, as a share of all the "
        "star's light, unmodulated light removed as the thesis proposes: by subtracting the "
        "picture with a neutral pattern. Expected is what the description of the bench "
        "predicts for the patterns that were shown.",
        "The simulated panel has no reflecting frame around its active area, so that the vertical "
        "strikes of the thesis' pictures aren't there.",
    ]
    return StudyResults(
        rows, plates, notes, {shape: _measured_quality(one) for shape, one in found.items()}
    )


def _row(shape: str, report: PSFReport) -> ResultRow:
    """Return the row of a shape: light within it, likeness and speckle."""
    ours, asked = _measured_quality(report), "-"
    if report.predicted is not None:
        modulated = report.predicted - report.unmodulated * report.neutral
        asked = _quality_text(_shape_quality(modulated, report))
    name = "EI letters" if shape == "letters" else shape
    return ResultRow(
        f"{name}: light within it, likeness, speckle",
        "picture only" if shape in PUBLISHED_SHAPES else "see below",
        asked,
        _quality_text(ours),
        ours["light"],
    )


def _measured_quality(report: PSFReport) -> dict[str, float]:
    noise = report.variance_without(report.unmodulated)
    return _shape_quality(report.modulated_psf, report, noise)


def _shape_quality(
    shape: Picture, report: PSFReport, noise: Picture | None = None
) -> dict[str, float]:
    """Rate a PSF, from which unmodulated light is removed, against its target's shape.

    "light" is the share of the star's light within the shape; "contrast" is the speckle contrast,
    without the camera's noise where its variance is given.
    """
    target = requested_psf(report)
    return {
        "light": metrics.efficiency(shape, target, 1.0),
        "correlation": correlation(shape, target),
        "contrast": metrics.speckle_contrast(shape, target, noise),
    }


def _quality_text(figures: Mapping[str, float]) -> str:
    return (
        f"{_format_percent(figures['light'])}, correlation {figures['correlation']:.3f}, "
        f"contrast {figures['contrast']:.2f}"
    )


def _format_percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _ring_row(report: PSFReport, camera: Camera, settings: ShapesSettings) -> ResultRow:
    """Compare the ring with the one that the thesis' authors published, at its radius."""
    share = ring_energy_share(report.modulated_psf, camera, settings.wavelength_nm * 1e-9)
    modulated = share / (1 - report.unmodulated)
    published = ", ".join(f"{energy:.3f} after {n}" for n, energy in RING_ENERGY.items())
    return ResultRow(
        "ring of 30 samples: modulated light at 20 to 40 samples from the axis",
        f"{published} iterations (computed from the published patterns)",
        "at least the published one",
        f"{modulated:.3f} through the bench, after {settings.iterations} of ours",
        modulated,
    )


def ring_energy_share(shape: Picture, camera: Camera, wavelength: float) -> float:
    """Return a PSF's light in the published ring's band, as a share of the star's."""
    y, x = (np.indices(shape.shape) - shape.shape[0] // 2) * camera.sensor.pitch
    radius = np.hypot(y, x) / (published_ring_sizes(camera, wavelength)[0] / RING_RADIUS_SAMPLES)
    low, high = RING_BAND
    return float(shape[(radius > low) & (radius < high)].sum())


def _overview(record: Record, found: Mapping[str, PSFReport]) -> StudyFigure:
    columns = len(found)
    figure = Figure(figsize=(3.1 * max(columns, 3), 10.2), dpi=100, layout="constrained")
    axes = figure.subplots(3, columns, squeeze=False)
    for column, (shape, report) in zip(axes.T, found.items(), strict=True):
        draw_linear(column[0], requested_psf(report), f"{shape}: asked for")
        draw_log(column[1], report.measured, "measured, 4 decades")
        draw_linear(column[2], report.modulated_psf, "without unmodulated light")
    return StudyFigure(
        "PSFs",
        figure,
        "Fig. 3.3 (a) to (e) shows the middle row, logarithmic as here. Below, the picture with "
        "a neutral pattern is subtracted, and the scale is linear from black to the 99.8th "
        "percentile.",
    )


def _ring_figure(report: PSFReport, camera: Camera, settings: ShapesSettings) -> StudyFigure:
    figure = Figure(figsize=(11, 5.4), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    grey = read_published_ring()
    draw_linear(left, grey, "published, computed by its authors (569 iterations)")
    draw_linear(right, report.modulated_psf, "ours, through the bench")
    # Both pictures show the same part of the image plane.
    radius, _ = published_ring_sizes(camera, settings.wavelength_nm * 1e-9)
    sample = radius / RING_RADIUS_SAMPLES / camera.sensor.pitch
    middle = report.modulated_psf.shape[0] // 2
    reach = min(grey.shape[0] / 2 * sample, middle)
    right.set_xlim(middle - reach, middle + reach)
    right.set_ylim(middle + reach, middle - reach)
    return StudyFigure(
        "The published ring",
        figure,
        "Left: from github.com/cgtuebingen/computational_camera_phase_retrieval (MIT licence).",
    )
