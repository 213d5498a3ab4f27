"""PSFs of many shapes, through the bench (thesis Fig. 3.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from labapp.files.plan_file import PlanFile
from labapp.pictures.analysis.brackets import Picture
from labapp.pictures.analysis.star import PSFReport
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.psf_shapes import PUBLISHED, STUDY, Shape, ShapesSettings
from labapp.studies.contract import Plate, Results, Row
from labapp.studies.drawing import draw_log, draw_tone
from labapp.studies.published import RADIUS, RING_BAND, RING_ENERGY, published_ring, ring_sizes
from labapp.studies.stars import (
    bracket,
    correlation,
    measured_psfs,
    plan_of,
    psf_pattern,
    target_of,
)
from optics import metrics
from optics.camera import Camera
from optics.progress import Progress

_WINDOW = 128
"""Sensor pixels across a PSF."""


def plan(settings: ShapesSettings, camera: Camera) -> PlanFile:
    """The star with no pattern, and with one for each shape."""
    shapes = dict.fromkeys(settings.shapes)
    names = ["neutral", *shapes]
    return plan_of(
        STUDY,
        {
            shape: psf_pattern(settings, shape, **_sizes(shape, settings, camera))
            for shape in shapes
        },
        bracket(["star"], names, settings.wavelength_nm, exposures_ms=settings.exposures_ms),
    )


def _sizes(shape: Shape, settings: ShapesSettings, camera: Camera) -> dict[str, Any]:
    if shape == "letters":
        return {"text": settings.text, "height_um": 1.4 * settings.radius_um}
    if shape == "ring":
        radius, width = ring_sizes(camera, settings.wavelength_nm * 1e-9)
        return {"radius_um": radius * 1e6, "width_um": width * 1e6}
    return {"radius_um": settings.radius_um}


def evaluate(record: Record, settings: ShapesSettings, progress: Progress) -> Results:
    """Light within each shape, its likeness, and how smooth it is."""
    shapes = list(dict.fromkeys(settings.shapes))
    found = measured_psfs(record, shapes, settings.wavelength_nm, _WINDOW, progress)
    rows = [_row(shape, report) for shape, report in found.items()]
    camera = record.bench.build_camera()
    first = next(iter(found.values()))
    rows.append(
        Row(
            "light that no pattern moves, in the central peak",
            "a prominent central peak (no number)",
            f"{_said(camera.panel.unmodulated)} (bench file)",
            _said(first.unmodulated),
            first.unmodulated,
        )
    )
    plates = [_overview(record, found)]
    if "ring" in found:
        rows.append(_ring_row(found["ring"], camera, settings))
        plates.append(_ring_plate(found["ring"], camera, settings))
    notes = [
        "Light within a shape is where the target exceeds 2 % of its peak, as a share of all the "
        "star's light, unmodulated light removed as the thesis proposes: by subtracting the "
        "picture with a neutral pattern. Expected is what the description of the bench "
        "predicts for the patterns that were shown.",
        "The simulated panel has no reflecting frame around its active area, so that the vertical "
        "strikes of the thesis' pictures aren't there.",
    ]
    return Results(rows, plates, notes, {shape: _figures(one) for shape, one in found.items()})


def _row(shape: str, report: PSFReport) -> Row:
    ours = _figures(report)
    asked = {} if report.predicted is None else _figures_of(_predicted_shape(report), report)
    name = "EI letters" if shape == "letters" else shape
    return Row(
        f"{name}: light within it, likeness, speckle",
        "picture only" if shape in PUBLISHED else "see below",
        _in_words(asked) if asked else "-",
        _in_words(ours),
        ours["light"],
    )


def _figures(report: PSFReport) -> dict[str, float]:
    return _figures_of(report.shape, report)


def _figures_of(shape: Picture, report: PSFReport) -> dict[str, float]:
    """Of a PSF without its unmodulated light. light: of all the star's; contrast: of speckle."""
    target = target_of(report)
    return {
        "light": metrics.efficiency(shape, target, 1.0),
        "correlation": correlation(shape, target),
        "contrast": metrics.speckle_contrast(shape, target),
    }


def _predicted_shape(report: PSFReport) -> Picture:
    assert report.predicted is not None
    return report.predicted - report.unmodulated * report.neutral


def _in_words(figures: Mapping[str, float]) -> str:
    return (
        f"{_said(figures['light'])}, correlation {figures['correlation']:.3f}, "
        f"contrast {figures['contrast']:.2f}"
    )


def _said(share: float) -> str:
    return f"{100 * share:.1f} %"


def _ring_row(report: PSFReport, camera: Camera, settings: ShapesSettings) -> Row:
    """The ring that the thesis' authors published, at the radius of theirs."""
    share = ring_share(report.shape, camera, settings.wavelength_nm * 1e-9)
    modulated = share / (1 - report.unmodulated)
    published = ", ".join(f"{energy:.3f} after {n}" for n, energy in RING_ENERGY.items())
    return Row(
        "ring of 30 samples: modulated light at 20 to 40 samples from the axis",
        f"{published} iterations (computed from the published patterns)",
        "at least the published one",
        f"{modulated:.3f} through the bench, after {settings.iterations} of ours",
        modulated,
    )


def ring_share(shape: Picture, camera: Camera, wavelength: float) -> float:
    """Light of a PSF in the band around the published ring, as a share of the star's."""
    y, x = (np.indices(shape.shape) - shape.shape[0] // 2) * camera.sensor.pitch
    radius = np.hypot(y, x) / (ring_sizes(camera, wavelength)[0] / RADIUS)
    low, high = RING_BAND
    return float(shape[(radius > low) & (radius < high)].sum())


def _overview(record: Record, found: Mapping[str, PSFReport]) -> Plate:
    columns = len(found)
    figure = Figure(figsize=(3.1 * max(columns, 3), 10.2), dpi=100, layout="constrained")
    axes = figure.subplots(3, columns, squeeze=False)
    for column, (shape, report) in zip(axes.T, found.items(), strict=True):
        draw_tone(column[0], target_of(report), f"{shape}: asked for")
        draw_log(column[1], report.measured, "measured, 4 decades")
        draw_tone(column[2], report.shape, "without unmodulated light")
    return Plate(
        "PSFs",
        figure,
        "Fig. 3.3 (a) to (e) shows the middle row, logarithmic as here. Below, the picture with "
        "a neutral pattern is subtracted, and the scale is linear from black to the 99.8th "
        "percentile.",
    )


def _ring_plate(report: PSFReport, camera: Camera, settings: ShapesSettings) -> Plate:
    figure = Figure(figsize=(11, 5.4), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    grey = published_ring()
    half_samples = grey.shape[0] / 2
    draw_tone(left, grey, "published, computed by its authors (569 iterations)")
    draw_tone(right, report.shape, "ours, through the bench")
    # The same part of the image beside each other.
    sample = ring_sizes(camera, settings.wavelength_nm * 1e-9)[0] / RADIUS / camera.sensor.pitch
    middle = report.shape.shape[0] // 2
    reach = min(half_samples * sample, middle)
    right.set_xlim(middle - reach, middle + reach)
    right.set_ylim(middle + reach, middle - reach)
    return Plate(
        "The published ring",
        figure,
        "Left: from github.com/cgtuebingen/computational_camera_phase_retrieval (MIT licence).",
    )
