"""Draw a photograph before and after restoration, with its PSF and the residual, in one figure."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.common.figure_png import figure_to_png
from labapp.edof.trained_pattern import describe_decoder
from labapp.files.picture.photograph import Light
from labapp.files.picture.photograph_writing import encode_srgb
from labapp.pictures.reconstructing.decoding import DecodedPhotograph, DecodingProblem
from labapp.pictures.reconstructing.problem import RestorationProblem
from labapp.pictures.reconstructing.restoration import RestoredPicture

_TITLE_WIDTH = 170
"""Characters of a line of the title."""

_DRAWN_PSF = 257
"""Pixels along a side of the part of a mean PSF that is drawn. Chosen: most of its light is there,
and its rings can be told apart."""


def draw_before_after(
    problem: RestorationProblem, outcome: RestoredPicture, captions: tuple[str, str]
) -> bytes:
    """Draw a photograph before and after its restoration, under these captions, as a PNG file."""
    title = f"{problem.source}: {outcome.method}, {outcome.verdict}"
    beside = (
        partial(_draw_psf, psf=problem.psf),
        partial(_draw_residual, residual=outcome.residual_map),
    )
    shown = [
        screen_levels(problem.to_screen(light), problem.white)
        for light in (problem.blurred_bands, outcome.light)
    ]
    return _draw(title, shown, captions, beside)


def draw_before_decoded(
    posed: DecodingProblem, decoded: DecodedPhotograph, captions: tuple[str, str]
) -> bytes:
    """Draw a photograph before and after its decoding, under these captions, as a PNG file.

    Beside them are the pattern and the mean PSF over depths.
    """
    problem, white = posed.problem, posed.white
    title = f"{problem.source}: {describe_decoder(posed.pattern)}"
    beside = (
        partial(_draw_psf, psf=middle_of_psf(problem.psf), name="Mean PSF"),
        partial(_draw_pattern, grey=posed.pattern.grey),
    )
    shown = [screen_levels(light, white) for light in (problem.light, decoded.light)]
    return _draw(title, shown, captions, beside)


def _draw(
    title: str,
    pictures: Sequence[NDArray[np.uint8]],
    captions: tuple[str, str],
    beside: tuple[Callable[[Axes], None], Callable[[Axes], None]],
) -> bytes:
    """Draw two pictures, with two more drawings beside them, as PNG."""
    rows, columns = pictures[0].shape[:2]
    tall = 5.4 * min(max(rows / columns, 0.5), 1.6)
    figure = Figure(figsize=(14.5, tall + 0.9), dpi=110, layout="constrained")
    figure.suptitle(textwrap.fill(title, _TITLE_WIDTH), fontsize=11)
    grid = figure.add_gridspec(2, 3, width_ratios=[1, 1, 0.46])
    for column, (shown, caption) in enumerate(zip(pictures, captions, strict=True)):
        axes = figure.add_subplot(grid[:, column])
        axes.imshow(shown, cmap="gray", vmin=0, vmax=255)
        _strip_ticks(axes, caption)
    for row, draw in enumerate(beside):
        draw(figure.add_subplot(grid[row, 2]))
    return figure_to_png(figure)


def screen_levels(light: Light, white: float) -> NDArray[np.uint8]:
    """Convert light to 8-bit sRGB levels, (rows, columns[, 3]), of at most 1200 pixels a side."""
    picture = np.moveaxis(np.nan_to_num(light) / white, 0, -1)
    scale = 1200 / max(picture.shape[:2])
    if scale < 1:
        size = [max(round(n * scale), 1) for n in picture.shape[1::-1]]
        small = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
        return encode_srgb(small)
    return encode_srgb(picture[..., 0] if picture.shape[-1] == 1 else picture)


def middle_of_psf(psf: Light) -> Light:
    """Cut out the middle of a PSF that is larger than its drawing has room for."""
    top, left = (max(n - _DRAWN_PSF, 0) // 2 for n in psf.shape[1:])
    return psf[:, top : psf.shape[1] - top, left : psf.shape[2] - left]


def _draw_psf(axes: Axes, psf: Light, name: str = "PSF") -> None:
    """Draw the mean PSF of all bands over four decades."""
    mean = psf.mean(0)
    peak, lowest_ratio = float(mean.max()), 1e-4
    norm = LogNorm(peak * lowest_ratio, peak)
    drawn = axes.imshow(np.maximum(mean, peak * lowest_ratio), cmap="magma", norm=norm)
    _strip_ticks(axes, f"{name}, {psf.shape[2]} x {psf.shape[1]} pixels, 4 decades")
    axes.figure.colorbar(drawn, ax=axes, shrink=0.85, pad=0.02)


def _draw_residual(axes: Axes, residual: Light) -> None:
    """Draw what the restoration leaves unexplained: the mean residual of all bands."""
    mean = residual.mean(0) * np.sqrt(len(residual))
    axes.set_facecolor("0.25")
    drawn = axes.imshow(mean, cmap="RdBu_r", vmin=-4.0, vmax=4.0)
    _strip_ticks(axes, "Unexplained, in units of the noise")
    axes.figure.colorbar(drawn, ax=axes, shrink=0.85, pad=0.02)


def _draw_pattern(axes: Axes, grey: NDArray[np.uint8]) -> None:
    axes.imshow(grey, cmap="gray")
    _strip_ticks(axes, f"Pattern, {grey.shape[1]} x {grey.shape[0]} pixels")


def _strip_ticks(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set(xticks=[], yticks=[])
