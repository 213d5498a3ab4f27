"""Figures of extended depth of field: PSFs over depth, scores and decoded pictures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from labapp.pictures.analysis.brackets import Picture
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.edof import EdofSettings
from labapp.studies.contract import StudyFigure
from labapp.studies.edof_decoding import (
    OBJECTS,
    PRINT,
    Pictures,
    SharpPicture,
    labels_of,
    photograph_name,
)
from labapp.studies.edof_pattern import DESIGNED, NEUTRAL, PATTERNS, RINGS
from labapp.studies.edof_psfs import PSFs
from labapp.studies.figure_drawing import draw_log, draw_pattern, draw_photograph


def draw_results(
    record: Record,
    psfs: PSFs,
    pictures: Pictures,
    sharp: Mapping[str, SharpPicture],
    settings: EdofSettings,
) -> list[StudyFigure]:
    """Draw PSFs over depth, scores over depth, and decoded pictures."""
    distances = sorted(settings.distances_m)
    chosen = sorted({distances[0], distances[len(distances) // 2], distances[-1]})
    shown = {f"{one:g} m": photograph_name(one) for one in chosen}
    prints = StudyFigure(
        "Prints at several distances",
        _picture_rows(pictures, shown, sharp[PRINT], settings.scored_px),
        "Fig. 5.9 to 5.11: each pattern as taken, and decoded; PSNR in linear light. The part that "
        "is scored.",
    )
    found = [
        _psfs_figure(record, psfs, settings),
        _scores_figure(psfs, pictures, settings),
        prints,
    ]
    if settings.layered:
        objects = StudyFigure(
            "Objects that hide each other",
            _picture_rows(pictures, {OBJECTS: OBJECTS}, sharp[OBJECTS], None),
            "Fig. 5.13: a filter takes a picture for a convolution, which it isn't where an object "
            "hides a part of the light behind it. PSNR is of the middle.",
        )
        found.append(objects)
    return found


def _psfs_figure(record: Record, psfs: PSFs, settings: EdofSettings) -> StudyFigure:
    """Draw measured and simulated PSFs at all distances, each pattern on one scale."""
    distances = settings.distances_m
    figure = Figure(figsize=(2.0 * len(distances) + 3.8, 8.6), dpi=100, layout="constrained")
    widths = [1.8, *[1.0] * len(distances)]
    grid = figure.add_gridspec(4, len(widths), width_ratios=widths)
    for number, name in enumerate((DESIGNED, RINGS)):
        first = 2 * number
        # A pattern that uses a part of the grey levels is drawn from black to white.
        grey = record.pattern(name)
        shown = (grey.astype(np.float64) * (255 / max(int(grey.max()), 1))).round().astype(np.uint8)
        draw_pattern(figure.add_subplot(grid[first : first + 2, 0]), shown, name)
        peak = max(float(psfs[name, distance].measured.max()) for distance in distances)
        for column, distance in enumerate(distances, 1):
            for row, kind in enumerate(("measured", "simulated"), first):
                axes = figure.add_subplot(grid[row, column])
                draw_log(axes, getattr(psfs[name, distance], kind), f"{kind}, {distance:g} m", peak)
    return StudyFigure(
        "PSFs over depth",
        figure,
        f"Fig. 5.7 and 5.8: {settings.psf_px} pixels along a side, 4 decades below the brightest "
        "pixel of a pattern. Measured on stars, unmodulated light included.",
    )


def _scores_figure(psfs: PSFs, pictures: Pictures, settings: EdofSettings) -> StudyFigure:
    """Draw the distances of PSFs, and the PSNR of decoded prints, over depth."""
    depths = [1 / distance for distance in settings.distances_m]
    figure = Figure(figsize=(13, 4.6), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    for name in (DESIGNED, RINGS):
        own = [psfs[name, distance] for distance in settings.distances_m]
        (line,) = left.plot(depths, [100 * one.beside_noise for one in own], "o-", label=name)
        left.plot(
            depths, [100 * one.noise for one in own], ":", color=line.get_color(),
            label=f"{name}, noise alone",
        )  # fmt: skip
    left.set(
        xlabel="depth / dioptres",
        ylabel="L2 distance / %",
        title="PSFs, measured to simulated",
        ylim=(0, None),
    )
    left.legend(fontsize=9)
    styles = ["--", "-", "-.", ":"]
    colours = {DESIGNED: "C0", RINGS: "C1", NEUTRAL: "C2"}
    for name in PATTERNS:
        for label, style in zip(labels_of(pictures), styles, strict=False):
            levels = [
                pictures[photograph_name(one), name, label].psnr for one in settings.distances_m
            ]
            right.plot(depths, levels, "o" + style, color=colours[name], label=f"{name}; {label}")
    right.set(xlabel="depth / dioptres", ylabel="PSNR / dB, linear light", title="Print")
    right.legend(fontsize=8)
    return StudyFigure(
        "Over depth", figure, "0 dioptres is infinity. Distances of PSFs are without noise's part."
    )


def _picture_rows(
    pictures: Pictures, targets: Mapping[str, str], sharp: SharpPicture, side: int | None
) -> Figure:
    """Draw pictures in a row for each target, with columns for patterns and decoders.

    The first column is what the pictures should be.
    targets: names of the targets by their words in titles.
    """
    columns = [(name, label) for name in PATTERNS for label in labels_of(pictures)]
    size = 2.9 * (len(columns) + 1), 3.5 * len(targets) + 0.3
    figure = Figure(figsize=size, dpi=100, layout="constrained")
    axes = figure.subplots(len(targets), len(columns) + 1, squeeze=False)
    # An empty title leaves room that constrained layout doesn't leave above square axes.
    figure.suptitle(" ")
    for line, (title, target) in zip(axes, targets.items(), strict=True):
        draw_photograph(line[0], _crop_middle(sharp.image, side), "in focus", 1.0)
        for one, (name, label) in zip(line[1:], columns, strict=True):
            found = pictures[target, name, label]
            words = f"{title}, {name}\n{label}, {found.psnr:.1f} dB"
            draw_photograph(one, _crop_middle(found.image, side), words, 1.0)
    return figure


def _crop_middle(image: Picture, side: int | None) -> Picture:
    """Cut the middle out of a picture; None leaves it whole."""
    if side is None or side >= min(image.shape):
        return image
    top, left = ((n - side) // 2 for n in image.shape)
    return np.asarray(image[top : top + side, left : left + side])
