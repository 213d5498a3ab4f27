"""Refocusing by a Fresnel lens on the SLM (thesis Fig. 3.6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.pictures.analysis.brackets import Bracket, Picture, find, merge_all
from labapp.runs.record.reader import Record
from labapp.studies.bricks import BRICKS, Region, regions_of, sharpened
from labapp.studies.catalogue.refocus import STUDY, RefocusSettings
from labapp.studies.contract import Plate, Results, Row
from labapp.studies.drawing import draw_grey, draw_log, draw_panel
from labapp.studies.focusing import DefocusedStar, Focus, focus_of, opening
from labapp.studies.stars import bracket, plan_of
from optics.camera import Camera
from optics.progress import Progress
from optics.shadow import in_focus


def power(settings: RefocusSettings, camera: Camera) -> float:
    """Dioptres that the SLM must add: the thin-lens equation at both distances."""
    return 1 / settings.near_m - 1 / in_focus(camera)


def plan(settings: RefocusSettings, camera: Camera) -> PlanFile:
    """Stars at several distances and the bricks, without a pattern and with a Fresnel lens."""
    added = power(settings, camera)
    if abs(added) < 1e-6:
        raise UserError(
            f"study refocus: near_m is {settings.near_m:g}, where the lens of the bench is "
            "focused already. Choose another distance."
        )
    nm, both = settings.wavelength_nm, ["neutral", "lens"]
    lens = {"kind": "lens", "focal_length_m": 1 / added, "wavelength_nm": nm}
    stars = {star_at(metres): {"distance_m": metres} for metres in settings.stars_m}
    blocks = [bracket(list(stars), both, nm, exposures_ms=settings.star_ms)]
    if settings.bricks:
        blocks.append(bracket([BRICKS], both, nm, exposures_ms=settings.scene_ms))
    return plan_of(STUDY, {"lens": lens}, *blocks, targets=stars)


def star_at(metres: float) -> str:
    """The target's name."""
    return f"star-{round(100 * metres)}cm"


def evaluate(record: Record, settings: RefocusSettings, progress: Progress) -> Results:
    """Where the focus lies without and with the lens, and what becomes of the bricks."""
    camera = record.bench.build_camera()
    brackets = merge_all(record, progress.part(0, 0.8))
    metres = settings.wavelength_nm * 1e-9

    def taken(target: str, pattern: str) -> Bracket:
        return find(brackets, target, pattern, metres, record.path)

    stars = [
        DefocusedStar(
            distance, *(taken(star_at(distance), name).rate for name in ("neutral", "lens"))
        )
        for distance in sorted(settings.stars_m)
    ]
    nearest = min(stars, key=lambda star: abs(1 / star.distance - 1 / settings.near_m))
    halo = nearest.unmodulated
    before = focus_of(stars, [star.plain for star in stars], camera)
    after = focus_of(stars, [star.coded - halo * star.plain for star in stars], camera)
    rows = [*_rows(before, after, settings, camera), _halo(halo, nearest, camera)]
    plates = [_focus_plate(before, after, nearest, settings, camera)]
    if settings.bricks:
        progress.report(0.9, "bricks")
        scenes = [taken(BRICKS, name).rate for name in ("neutral", "lens")]
        regions = regions_of(record, camera)
        rows += sharpened(scenes, regions, settings.near_m)
        plates.insert(0, _scene_plate(scenes, record.pattern("lens"), regions, settings))
    data = {"before": vars(before), "after": vars(after)}
    notes = [
        "A star that is out of focus is the projection of the pupil: its mean square radius is "
        "a parabola of 1/distance, with its least at the distance in focus and the opening "
        "z² <x² + y²> (z from lens to sensor, the mean over the pupil). The rectangle's "
        "diffraction adds the same at all distances. Light that the SLM can't modulate is "
        "subtracted before: it stays in focus where the lens was.",
    ]
    return Results(rows, plates, notes, data)


def _rows(before: Focus, after: Focus, settings: RefocusSettings, camera: Camera) -> list[Row]:
    z, added = camera.lens.image_distance, power(settings, camera)
    geometric = z**2 * opening(camera)
    blur = math.sqrt(geometric) * abs(added)
    near = 1 / settings.near_m
    blurred = math.sqrt(max(_at(before, near) - before.least, 0.0))
    cleared = math.sqrt(max(_at(after, near) - after.least, 0.0))
    return [
        Row(
            "distance in focus, no pattern",
            "the farthest brick (no number)",
            f"{in_focus(camera):.3f} m",
            f"{1 / before.best:.3f} m",
            1 / before.best,
        ),
        Row(
            f"distance in focus, Fresnel lens of {1 / added:.3g} m",
            "the nearer figure (no number)",
            f"{settings.near_m:.3f} m: thin-lens equation",
            f"{1 / after.best:.3f} m",
            1 / after.best,
        ),
        Row(
            f"blur of a star at {settings.near_m:g} m, no pattern, root mean square",
            "out of focus (picture only)",
            f"{1e6 * blur:.1f} µm: projection of the pupil",
            f"{1e6 * blurred:.1f} µm",
            blurred,
        ),
        Row(
            "the same with the Fresnel lens, beyond diffraction",
            "high-frequency edges (picture only)",
            "0 µm",
            f"{1e6 * cleared:.1f} µm",
            cleared,
        ),
        Row(
            "opening of the parabola, over z² <x² + y²> of the pupil",
            "-",
            "1",
            f"{before.slope / geometric:.3f} before, {after.slope / geometric:.3f} after",
            after.slope / geometric,
        ),
    ]


def _at(focus: Focus, vergence: float) -> float:
    return focus.least + focus.slope * (vergence - focus.best) ** 2


def _halo(share: float, star: DefocusedStar, camera: Camera) -> Row:
    return Row(
        f"halo: light of a star at {star.distance:g} m that stays out of focus",
        "a halo around each object (picture only)",
        f"{100 * camera.panel.unmodulated:.1f} % (bench file)",
        f"{100 * share:.1f} %",
        share,
    )


def _scene_plate(
    scenes: Sequence[Picture],
    grey: Any,
    regions: Sequence[Region],
    settings: RefocusSettings,
) -> Plate:
    figure = Figure(figsize=(15, 9.8), dpi=100, layout="constrained")
    top, bottom = np.asarray(figure.subfigures(2, 1, height_ratios=[1.25, 1]))
    white = float(np.percentile(scenes[0], 99.8))
    titles = ("(a) no pattern", f"(b) Fresnel lens, in focus at {settings.near_m:g} m")
    for axes, scene, title in zip(top.subplots(1, 2), scenes, titles, strict=True):
        draw_grey(axes, scene, title, white)
    axes = bottom.subplots(1, 3, width_ratios=[1.0, 1.0, 1.6])
    if regions:
        distance, y, x = min(regions, key=lambda one: abs(one[0] - settings.near_m))
        for one, scene, title in zip(axes, scenes, ("no pattern", "Fresnel lens"), strict=False):
            draw_grey(one, scene[y, x], f"the brick at {distance:g} m, {title}", white)
    else:
        axes[0].axis("off")
        axes[1].axis("off")
    draw_panel(axes[2], grey, "(c) the Fresnel lens on the SLM")
    return Plate("Bricks", figure, "As Fig. 3.6: before, after, and the pattern on the SLM.")


def _focus_plate(
    before: Focus, after: Focus, star: DefocusedStar, settings: RefocusSettings, camera: Camera
) -> Plate:
    figure = Figure(figsize=(14, 5), dpi=100, layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.7, 1, 1])
    _draw_focus(left, before, after, settings, camera)
    peak = float(star.coded.max())
    draw_log(middle, star.plain, f"star at {star.distance:g} m, no pattern", peak)
    draw_log(right, star.coded, "with the Fresnel lens", peak)
    return Plate(
        "Blur of stars",
        figure,
        "Left: dots are measured, lines the projection of the pupil with the measured least blur. "
        "Right: PSFs over four decades; the halo is light that the SLM doesn't modulate.",
    )


def _draw_focus(
    axes: Axes, before: Focus, after: Focus, settings: RefocusSettings, camera: Camera
) -> None:
    z2 = camera.lens.image_distance**2 * opening(camera)
    line = np.linspace(min(before.vergences) - 0.03, max(before.vergences) + 0.03, 300)
    centres = (1 / in_focus(camera), 1 / settings.near_m)
    for focus, centre, name, colour in zip(
        (before, after), centres, ("no pattern", "Fresnel lens"), ("C0", "C1"), strict=True
    ):
        expected = np.sqrt(np.maximum(focus.least, 0) + z2 * (line - centre) ** 2)
        axes.plot(line, 1e6 * expected, "-", color=colour, alpha=0.5)
        axes.plot(focus.vergences, 1e6 * np.sqrt(focus.squares), "o", color=colour, label=name)
    axes.set_xlabel("1 / distance, dioptres")
    axes.set_ylabel("root mean square radius, µm")
    axes.set_title("Blur of a star by its distance")
    axes.grid(alpha=0.3)
    axes.legend()
