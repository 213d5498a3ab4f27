"""Figures of multispectral imaging: bands, colours, snapshots and PSFs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.files.cubes import SpectralCube
from labapp.files.wavelengths import format_nanometres
from labapp.spectral.drawing import srgb_levels
from labapp.spectral.lights import ViewingLight
from labapp.spectral.problem import WHITE_PERCENTILE, SpectralProblem
from labapp.spectral.restoration import RestoredCube
from labapp.studies.contract import StudyFigure
from labapp.studies.figure_drawing import draw_log, draw_photograph

_COLUMN = 2.7
"""Width in inches of a picture of a band."""


def overview_figure(
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


def bands_figure(problem: SpectralProblem, restored: RestoredCube) -> StudyFigure:
    """Draw each restored band beside the true one, with the PSFs below."""
    count = len(problem.wavelengths)
    figure = Figure(figsize=(_COLUMN * max(count, 3), 6.4), dpi=100, layout="constrained")
    columns = figure.subplots(3, count, squeeze=False).T
    for band, axes in enumerate(columns):
        level = "" if restored.scores is None else f", {restored.scores.bands[band].psnr:.1f} dB"
        name = format_nanometres(problem.wavelengths[band])
        draw_photograph(axes[0], restored.cube.values[band], f"{name}{level}", 1.0)
        if restored.truth is not None:
            draw_photograph(axes[1], restored.truth.values[band], "true", 1.0)
        draw_log(axes[2], problem.psfs[band], "PSF, 4 decades")
    return StudyFigure("Bands", figure, "Fig. 4.3 (c) to (h), and Fig. 4.8 (a) to (l).")


def draw_colours(axes: Axes, cube: SpectralCube, light: ViewingLight, title: str) -> None:
    """Draw a cube's colours in a light, as sRGB."""
    axes.imshow(srgb_levels(cube, light), interpolation="nearest")
    axes.set_title(title, fontsize=11)
    axes.set(xticks=[], yticks=[])


def psf_figure(
    stacks: Mapping[str, NDArray[Any]], wavelengths: tuple[float, ...], caption: str
) -> StudyFigure:
    """Draw the PSFs of designs, a row for each design and a column for each band."""
    rows, count = len(stacks), len(wavelengths)
    figure = Figure(figsize=(2.2 * count, 2.4 * rows), dpi=100, layout="constrained")
    axes = figure.subplots(rows, count, squeeze=False)
    for row, (name, stack) in zip(axes, stacks.items(), strict=True):
        peak = float(stack.max())
        for one, psf, wavelength in zip(row, stack, wavelengths, strict=True):
            draw_log(one, psf, f"{name}, {format_nanometres(wavelength)}", peak)
    return StudyFigure("PSFs", figure, caption)
