"""Draw a photograph before and after restoration, with its PSF and the residual, in one picture."""

from __future__ import annotations

import textwrap

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.common.figure_png import figure_to_png
from labapp.files.photograph_file import Light, encode_srgb
from labapp.pictures.reconstructing.problem import RestorationProblem
from labapp.pictures.reconstructing.restoration import RestoredPicture

_TITLE_WIDTH = 170
"""Characters of a line of the title."""


def draw_before_after(
    problem: RestorationProblem, outcome: RestoredPicture, captions: tuple[str, str]
) -> bytes:
    """Draw a picture before and after its restoration as PNG, and return the file's bytes.

    `captions` are the titles of the photograph before and after.
    """
    rows, columns = problem.light.shape[1:]
    tall = 5.4 * min(max(rows / columns, 0.5), 1.6)
    figure = Figure(figsize=(14.5, tall + 0.9), dpi=110, layout="constrained")
    title = f"{problem.source}: {outcome.method}, {outcome.verdict}"
    figure.suptitle(textwrap.fill(title, _TITLE_WIDTH), fontsize=11)
    grid = figure.add_gridspec(2, 3, width_ratios=[1, 1, 0.46])
    before, after = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[:, 1])
    for axes, light, title in zip(
        (before, after), (problem.blurred_bands, outcome.light), captions, strict=True
    ):
        shown = screen_levels(problem.to_screen(light), problem.white)
        axes.imshow(shown, cmap="gray", vmin=0, vmax=255)
        _strip_ticks(axes, title)
    _draw_psf(figure.add_subplot(grid[0, 2]), problem.psf)
    _draw_residual(figure.add_subplot(grid[1, 2]), outcome.residual_map)
    return figure_to_png(figure)


def screen_levels(light: Light, white: float) -> NDArray[np.uint8]:
    """Return a picture, restored or not, as 8-bit sRGB levels, (rows, columns[, 3]).

    A picture whose longer side exceeds 1200 pixels is averaged down to that.
    """
    picture = np.moveaxis(np.nan_to_num(light) / white, 0, -1)
    scale = 1200 / max(picture.shape[:2])
    if scale < 1:
        size = [max(round(n * scale), 1) for n in picture.shape[1::-1]]
        small = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
        return encode_srgb(small)
    return encode_srgb(picture[..., 0] if picture.shape[-1] == 1 else picture)


def _draw_psf(axes: Axes, psf: Light) -> None:
    """Draw the PSF with which a picture was restored."""
    mean = psf.mean(0)
    peak, lowest_ratio = float(mean.max()), 1e-4
    norm = LogNorm(peak * lowest_ratio, peak)
    drawn = axes.imshow(np.maximum(mean, peak * lowest_ratio), cmap="magma", norm=norm)
    _strip_ticks(axes, f"PSF, {psf.shape[2]} x {psf.shape[1]} pixels, 4 decades")
    axes.figure.colorbar(drawn, ax=axes, shrink=0.85, pad=0.02)


def _draw_residual(axes: Axes, residual: Light) -> None:
    """Draw what the restored picture leaves unexplained: the mean residual of all bands.

    The residual is drawn in units of the noise.
    """
    mean = residual.mean(0) * np.sqrt(len(residual))
    axes.set_facecolor("0.25")
    drawn = axes.imshow(mean, cmap="RdBu_r", vmin=-4.0, vmax=4.0)
    _strip_ticks(axes, "Unexplained, in units of the noise")
    axes.figure.colorbar(drawn, ax=axes, shrink=0.85, pad=0.02)


def _strip_ticks(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set(xticks=[], yticks=[])
