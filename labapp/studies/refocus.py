"""Study of refocusing by a Fresnel lens on the SLM (thesis Fig. 3.6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.scene_targets import LayersTable
from labapp.pictures.analysis.brackets import Bracket, Picture, find_bracket, merge_all
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.refocus import STUDY, RefocusSettings
from labapp.studies.contract import ResultRow, StudyFigure, StudyResults
from labapp.studies.figure_drawing import draw_log, draw_pattern, draw_photograph
from labapp.studies.focusing import (
    DefocusedStar,
    FocusCurve,
    fit_focus_curve,
    mean_square_pupil_radius,
)
from labapp.studies.stars import acquisition_block, build_study_plan
from optics.camera import Camera
from optics.camera.pupil import panel_to_focus_distance
from optics.progress import Progress

BRICKS_TARGET = "bricks"
"""Name of the target with the bricks."""

BrickRegion = tuple[float, slice, slice]
"""A brick's distance in metres, and the rows and columns of the sensor that see it."""


def brick_regions(record: Record, camera: Camera) -> list[BrickRegion]:
    """Return where the sensor sees the bricks of the simulated scene, the nearest first.

    The list is empty for a real scene, whose layout isn't known.
    """
    table = record.scene.targets.get(BRICKS_TARGET) if record.scene else None
    if not isinstance(table, LayersTable):
        return []
    found = []
    for layer in table.layers:
        if layer.picture.kind != "brick":
            continue
        scale = camera.magnification(layer.distance_m) / camera.sensor.pitch * 1e-3
        sides = []
        for offset, size, pixels in zip(
            layer.picture.offset_mm, layer.picture.size_mm, camera.sensor.shape, strict=True
        ):
            middle, half = pixels / 2 + offset * scale, (size / 2 + 3) * scale
            sides.append(slice(max(0, round(middle - half)), min(pixels, round(middle + half))))
        found.append((layer.distance_m, sides[0], sides[1]))
    return found


def sharpness_rows(
    scenes: Sequence[Picture], regions: Sequence[BrickRegion], near: float
) -> list[ResultRow]:
    """Compare the sharpness of bricks without and with the lens on the SLM.

    scenes: the pictures without and with the lens.
    near: distance that the lens brings into focus, metres.
    """
    rows = []
    for distance, y, x in regions:
        plain, coded = (edge_steepness(scene[y, x]) for scene in scenes)
        ratio = coded / plain
        what = f"steepest edges of the brick at {distance:g} m, with the lens over without"
        wanted = "more than 1" if abs(distance - near) < 0.05 else "-"
        if distance == max(one[0] for one in regions):
            wanted = "less than 1"
        rows.append(ResultRow(what, "picture only", wanted, f"{ratio:.2f}", ratio))
    return rows


def edge_steepness(picture: Picture) -> float:
    """Return the steepness of a picture's steepest edges, relative to its range.

    This is the 99th percentile of the gradient over the range of the picture's values. The gradient
    is taken over two pixels, which reduces the influence of noise.
    """
    y = picture[2:, 1:-1] - picture[:-2, 1:-1]
    x = picture[1:-1, 2:] - picture[1:-1, :-2]
    low, high = np.percentile(picture, [1, 99])
    return float(np.percentile(np.hypot(y, x), 99) / (high - low))


def added_lens_power(settings: RefocusSettings, camera: Camera) -> float:
    """Return the power in dioptres that the SLM must add to refocus, for thin lenses."""
    return 1 / settings.near_m - 1 / panel_to_focus_distance(camera)


def plan(settings: RefocusSettings, camera: Camera) -> PlanFile:
    """Plan stars at several distances and bricks, without and with a Fresnel lens."""
    added = added_lens_power(settings, camera)
    if abs(added) < 1e-6:
        raise UserError(
            f"study refocus: near_m is {settings.near_m:g}, where the lens of the bench is "
            "focused already. Choose another distance."
        )
    nm, both = settings.wavelength_nm, ["neutral", "lens"]
    lens = {"kind": "lens", "focal_length_m": 1 / added, "wavelength_nm": nm}
    stars = {star_target_name(metres): {"distance_m": metres} for metres in settings.stars_m}
    blocks = [acquisition_block(list(stars), both, nm, exposures_ms=settings.star_ms)]
    if settings.bricks:
        blocks.append(acquisition_block([BRICKS_TARGET], both, nm, exposures_ms=settings.scene_ms))
    return build_study_plan(STUDY, {"lens": lens}, *blocks, targets=stars)


def star_target_name(metres: float) -> str:
    """Return the target name of a star at a distance in metres, such as "star-160cm"."""
    return f"star-{round(100 * metres)}cm"


def evaluate(record: Record, settings: RefocusSettings, progress: Progress) -> StudyResults:
    """Find the focus without and with the lens, and the bricks' sharpness."""
    camera = record.camera
    brackets = merge_all(record, progress.part(0, 0.8))
    metres = settings.wavelength_nm * 1e-9

    def bracket_of(target: str, pattern: str) -> Bracket:
        return find_bracket(brackets, target, pattern, metres, record.path)

    stars = [
        DefocusedStar(
            distance,
            *(bracket_of(star_target_name(distance), name).rate for name in ("neutral", "lens")),
        )
        for distance in sorted(settings.stars_m)
    ]
    nearest = min(stars, key=lambda star: abs(1 / star.distance - 1 / settings.near_m))
    halo = nearest.unmodulated_share
    before = fit_focus_curve(stars, [star.plain for star in stars], camera)
    after = fit_focus_curve(stars, [star.coded - halo * star.plain for star in stars], camera)
    row = ResultRow(
        f"halo: light of a star at {nearest.distance:g} m that stays out of focus",
        "a halo around each object (picture only)",
        f"{100 * camera.panel.unmodulated:.1f} % (bench file)",
        f"{100 * halo:.1f} %",
        halo,
    )
    rows = [*_focus_rows(before, after, settings, camera), row]
    plates = [_focus_figure(before, after, nearest, settings, camera)]
    if settings.bricks:
        progress.report(0.9, "bricks")
        scenes = [bracket_of(BRICKS_TARGET, name).rate for name in ("neutral", "lens")]
        regions = brick_regions(record, camera)
        rows += sharpness_rows(scenes, regions, settings.near_m)
        plates.insert(0, _bricks_figure(scenes, record.pattern("lens"), regions, settings))
    data = {"before": vars(before), "after": vars(after)}
    notes = [
        "A star that is out of focus is the projection of the pupil: its mean square radius is "
        "a parabola of 1/distance, with its least at the distance in focus and the opening "
        "z² <x² + y²> (z from lens to sensor, the mean over the pupil). The rectangle's "
        "diffraction adds the same at all distances. Light that the SLM can't modulate is "
        "subtracted before: it stays in focus where the lens was.",
    ]
    return StudyResults(rows, plates, notes, data)


def _focus_rows(
    before: FocusCurve, after: FocusCurve, settings: RefocusSettings, camera: Camera
) -> list[ResultRow]:
    z, added = camera.lens.image_distance, added_lens_power(settings, camera)
    geometric = z**2 * mean_square_pupil_radius(camera)
    blur = math.sqrt(geometric) * abs(added)
    near = 1 / settings.near_m
    blurred = math.sqrt(max(_square_radius_at(before, near) - before.least, 0.0))
    cleared = math.sqrt(max(_square_radius_at(after, near) - after.least, 0.0))
    return [
        ResultRow(
            "distance in focus, no pattern",
            "the farthest brick (no number)",
            f"{panel_to_focus_distance(camera):.3f} m",
            f"{1 / before.best:.3f} m",
            1 / before.best,
        ),
        ResultRow(
            f"distance in focus, Fresnel lens of {1 / added:.3g} m",
            "the nearer figure (no number)",
            f"{settings.near_m:.3f} m: thin-lens equation",
            f"{1 / after.best:.3f} m",
            1 / after.best,
        ),
        ResultRow(
            f"blur of a star at {settings.near_m:g} m, no pattern, root mean square",
            "out of focus (picture only)",
            f"{1e6 * blur:.1f} µm: projection of the pupil",
            f"{1e6 * blurred:.1f} µm",
            blurred,
        ),
        ResultRow(
            "the same with the Fresnel lens, beyond diffraction",
            "high-frequency edges (picture only)",
            "0 µm",
            f"{1e6 * cleared:.1f} µm",
            cleared,
        ),
        ResultRow(
            "opening of the parabola, over z² <x² + y²> of the pupil",
            "-",
            "1",
            f"{before.slope / geometric:.3f} before, {after.slope / geometric:.3f} after",
            after.slope / geometric,
        ),
    ]


def _square_radius_at(focus: FocusCurve, vergence: float) -> float:
    return focus.least + focus.slope * (vergence - focus.best) ** 2


def _bricks_figure(
    scenes: Sequence[Picture], grey: Any, regions: Sequence[BrickRegion], settings: RefocusSettings
) -> StudyFigure:
    figure = Figure(figsize=(15, 9.8), dpi=100, layout="constrained")
    top, bottom = np.asarray(figure.subfigures(2, 1, height_ratios=[1.25, 1]))
    white = float(np.percentile(scenes[0], 99.8))
    titles = ("(a) no pattern", f"(b) Fresnel lens, in focus at {settings.near_m:g} m")
    for axes, scene, title in zip(top.subplots(1, 2), scenes, titles, strict=True):
        draw_photograph(axes, scene, title, white)
    axes = bottom.subplots(1, 3, width_ratios=[1.0, 1.0, 1.6])
    if regions:
        distance, y, x = min(regions, key=lambda one: abs(one[0] - settings.near_m))
        for one, scene, title in zip(axes, scenes, ("no pattern", "Fresnel lens"), strict=False):
            draw_photograph(one, scene[y, x], f"the brick at {distance:g} m, {title}", white)
    else:
        for one in axes[:2]:
            one.axis("off")
    draw_pattern(axes[2], grey, "(c) the Fresnel lens on the SLM")
    return StudyFigure("Bricks", figure, "As Fig. 3.6: before, after, and the pattern on the SLM.")


def _focus_figure(
    before: FocusCurve,
    after: FocusCurve,
    star: DefocusedStar,
    settings: RefocusSettings,
    camera: Camera,
) -> StudyFigure:
    figure = Figure(figsize=(14, 5), dpi=100, layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.7, 1, 1])
    z2 = camera.lens.image_distance**2 * mean_square_pupil_radius(camera)
    line = np.linspace(min(before.vergences) - 0.03, max(before.vergences) + 0.03, 300)
    curves = (
        (before, 1 / panel_to_focus_distance(camera), "no pattern", "C0"),
        (after, 1 / settings.near_m, "Fresnel lens", "C1"),
    )
    for focus, centre, name, colour in curves:
        expected = np.sqrt(np.maximum(focus.least, 0) + z2 * (line - centre) ** 2)
        left.plot(line, 1e6 * expected, "-", color=colour, alpha=0.5)
        left.plot(focus.vergences, 1e6 * np.sqrt(focus.squares), "o", color=colour, label=name)
    left.set_xlabel("1 / distance, dioptres")
    left.set_ylabel("root mean square radius, µm")
    left.set_title("Blur of a star by its distance")
    left.grid(alpha=0.3)
    left.legend()
    peak = float(star.coded.max())
    draw_log(middle, star.plain, f"star at {star.distance:g} m, no pattern", peak)
    draw_log(right, star.coded, "with the Fresnel lens", peak)
    return StudyFigure(
        "Blur of stars",
        figure,
        "Left: dots are measured, lines the projection of the pupil with the measured least blur. "
        "Right: PSFs over four decades; the halo is light that the SLM doesn't modulate.",
    )
