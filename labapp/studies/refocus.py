"""Refocusing by a Fresnel lens on the SLM (thesis Fig. 3.6)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic import Field

from labapp.analysis.brackets import Bracket, Picture, find, merge_all
from labapp.analysis.star import centre_of, cut
from labapp.errors import UserError
from labapp.files.pattern_table import Positive
from labapp.files.plan_file import PlanFile
from labapp.files.reading import validate
from labapp.files.scene_targets import LayersTable
from labapp.record.reader import Record
from labapp.studies.contract import Plate, Results, Row, Settings, Study
from labapp.studies.drawing import draw_grey, draw_log, draw_panel
from labapp.studies.stars import NEUTRAL
from optics.camera import Camera
from optics.progress import Progress
from optics.stop.shadow import in_focus

_WINDOW = 192
"""Sensor pixels across a defocused star."""

_ARM = 6
"""Pixels around the axes that are left to the diffraction of a rectangle in focus."""

BRICKS = "bricks"


class RefocusSettings(Settings):
    """What the lens on the SLM shall bring into focus, and where stars tell whether it does."""

    QUICK: ClassVar[Mapping[str, Any]] = {"stars_m": [1.4, 1.6, 2.0], "scene_ms": [400]}

    near_m: Annotated[
        Positive, Field(description="distance that the lens on the SLM is to bring into focus")
    ] = 1.6
    stars_m: Annotated[
        tuple[Positive, ...],
        Field(min_length=3, description="distances of stars: targets star-160cm and so on"),
    ] = (1.4, 1.6, 1.8, 2.0, 2.4)
    wavelength_nm: Annotated[Positive, Field(description="of the filter")] = 550.0
    star_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the stars")
    ] = (1.0, 16.0, 256.0)
    scene_ms: Annotated[
        tuple[Positive, ...], Field(min_length=1, description="bracket of the bricks")
    ] = (100.0, 800.0)


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
    block = {
        "patterns": ["neutral", "lens"],
        "wavelengths_nm": [settings.wavelength_nm],
        "interleave": [{"role": "dark", "frames": 4}],
    }
    data = {
        "version": 1,
        "title": STUDY.title,
        "targets": {star_at(metres): {"distance_m": metres} for metres in settings.stars_m},
        "patterns": {
            "neutral": dict(NEUTRAL),
            "lens": {
                "kind": "lens",
                "focal_length_m": 1 / added,
                "wavelength_nm": settings.wavelength_nm,
            },
        },
        "acquire": [
            block
            | {
                "targets": [star_at(metres) for metres in settings.stars_m],
                "exposures_ms": list(settings.star_ms),
            },
            block | {"targets": [BRICKS], "exposures_ms": list(settings.scene_ms)},
        ],
    }
    return validate(data, PlanFile, "study refocus")


def star_at(metres: float) -> str:
    """The target's name."""
    return f"star-{round(100 * metres)}cm"


@dataclass(frozen=True)
class Focus:
    """Blur of stars by their vergence, and the parabola through it.

    vergences: 1 / distance, dioptres. squares: mean square radius of each star, m². best: the
    vergence with the least blur. slope: m² a dioptre². least: m².
    """

    vergences: Sequence[float]
    squares: Sequence[float]
    best: float
    slope: float
    least: float


def evaluate(record: Record, settings: RefocusSettings, progress: Progress) -> Results:
    """Where the focus lies without and with the lens, and what becomes of the bricks."""
    camera = record.bench.build_camera()
    brackets = merge_all(record, record.plan, progress.part(0, 0.8))
    metres = settings.wavelength_nm * 1e-9

    def taken(target: str, pattern: str) -> Bracket:
        return find(brackets, target, pattern, metres, record.path)

    stars = [
        _Star(distance, *(taken(star_at(distance), name).rate for name in ("neutral", "lens")))
        for distance in sorted(settings.stars_m)
    ]
    nearest = min(stars, key=lambda star: abs(1 / star.distance - 1 / settings.near_m))
    halo = nearest.unmodulated
    before = _focus(stars, [star.plain for star in stars], camera)
    after = _focus(stars, [star.coded - halo * star.plain for star in stars], camera)
    progress.report(0.9, "bricks")
    scenes = [taken(BRICKS, name).rate for name in ("neutral", "lens")]
    rows = [*_rows(before, after, settings, camera), _halo(halo, nearest, camera)]
    regions = _regions(record, camera)
    rows += _sharpened(scenes, regions, settings)
    plates = [
        _scene_plate(scenes, record.pattern("lens"), regions, settings),
        _focus_plate(before, after, nearest, settings, camera),
    ]
    data = {"before": vars(before), "after": vars(after)}
    notes = [
        "A star that is out of focus is the projection of the pupil: its mean square radius is "
        "a parabola of 1/distance, with its least at the distance in focus and the opening "
        "z² <x² + y²> (z from lens to sensor, the mean over the pupil). The rectangle's "
        "diffraction adds the same at all distances. Light that the SLM can't modulate is "
        "subtracted before: it stays in focus where the lens was.",
    ]
    return Results(rows, plates, notes, data)


class _Star:
    """A star at a distance, without and with the lens: shares of its light, around its centre."""

    def __init__(self, distance: float, plain: Picture, coded: Picture) -> None:
        self.distance = distance
        centre = centre_of(plain)
        window = min(_WINDOW, *plain.shape)
        total = float(cut(plain, centre, window).sum())
        if not total > 0:
            raise UserError(
                f"the star at {distance:g} m is dark. Expose it longer: the setting 'star_ms'."
            )
        self.plain = cut(plain, centre, window) / total
        self.coded = cut(coded, centre, window) / total

    @property
    def unmodulated(self) -> float:
        """How much of the picture without the lens is in the one with it, beside its focus."""
        y, x = np.abs(np.indices(self.plain.shape) - self.plain.shape[0] // 2)
        beside = (y > _ARM) & (x > _ARM) & (self.plain > 0.2 * np.percentile(self.plain, 99))
        if not beside.any():
            return 0.0
        plain, coded = self.plain[beside], self.coded[beside]
        return float(np.clip((plain * coded).sum() / (plain * plain).sum(), 0, 1))


def _focus(stars: Sequence[_Star], pictures: Sequence[Picture], camera: Camera) -> Focus:
    vergences = [1 / star.distance for star in stars]
    squares = [_mean_square(picture) * camera.sensor.pitch**2 for picture in pictures]
    slope, linear, constant = np.polyfit(vergences, squares, 2)
    best = -linear / (2 * slope)
    return Focus(vergences, squares, float(best), float(slope), float(constant - slope * best**2))


def _mean_square(picture: Picture) -> float:
    """Of the radius about the centroid, pixels."""
    light = picture / picture.sum()
    y, x = np.indices(picture.shape)
    cy, cx = (y * light).sum(), (x * light).sum()
    return float((((y - cy) ** 2 + (x - cx) ** 2) * light).sum())


def opening(camera: Camera) -> float:
    """Mean of x² + y² over the panel within the stop, m²: of a star's blur by a dioptre, over
    the square of the image distance."""
    panel = camera.panel
    y, x = (
        (np.arange(n) - (n - 1) / 2)[shape] * panel.pitch
        for n, shape in zip(panel.shape, ((slice(None), None), (None, slice(None))), strict=True)
    )
    square = y**2 + x**2
    inside = square <= (camera.lens.stop_diameter / 2) ** 2
    return float(square[inside].mean())


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


def _halo(share: float, star: _Star, camera: Camera) -> Row:
    return Row(
        f"halo: light of a star at {star.distance:g} m that stays out of focus",
        "a halo around each object (picture only)",
        f"{100 * camera.panel.unmodulated:.1f} % (bench file)",
        f"{100 * share:.1f} %",
        share,
    )


Region = tuple[float, slice, slice]
"""Distance, rows and columns of a brick on the sensor."""


def _regions(record: Record, camera: Camera) -> list[Region]:
    """Where a simulated scene's bricks are seen, the nearest first; of a real one unknown."""
    table = record.scene.targets.get(BRICKS) if record.scene else None
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


def _sharpened(
    scenes: Sequence[Picture], regions: Sequence[Region], settings: RefocusSettings
) -> list[Row]:
    rows = []
    for distance, y, x in regions:
        plain, coded = (steepness(scene[y, x]) for scene in scenes)
        ratio = coded / plain
        wanted = "more than 1" if abs(distance - settings.near_m) < 0.05 else "-"
        if distance == max(one[0] for one in regions):
            wanted = "less than 1"
        rows.append(
            Row(
                f"steepest edges of the brick at {distance:g} m, with the lens over without",
                "picture only",
                wanted,
                f"{ratio:.2f}",
                ratio,
            )
        )
    return rows


def steepness(picture: Picture) -> float:
    """Of the steepest edges, relative to the picture's range: 99th percentile of the gradient
    over two pixels, so that noise counts little."""
    y = picture[2:, 1:-1] - picture[:-2, 1:-1]
    x = picture[1:-1, 2:] - picture[1:-1, :-2]
    low, high = np.percentile(picture, [1, 99])
    return float(np.percentile(np.hypot(y, x), 99) / (high - low))


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
    before: Focus, after: Focus, star: _Star, settings: RefocusSettings, camera: Camera
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


STUDY = Study(
    title="Refocusing by a Fresnel lens on the SLM",
    source="Figure 3.6, section 3.5.3",
    shows=(
        "Three bricks stand at three distances, and the camera is focused on the farthest. With "
        "a Fresnel lens on the SLM a nearer figure becomes sharp, as one sees on its arm and "
        "head; every object has a halo of light that wasn't modulated. No numbers are printed."
    ),
    method=(
        "The power of the Fresnel lens follows from the thin-lens equation. Bricks, and stars at "
        "several distances, are photographed without a pattern and with the lens."
    ),
    settings=RefocusSettings,
    plan=plan,
    evaluate=evaluate,
    scene="studies/refocus.toml",
)
