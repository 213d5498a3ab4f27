"""Pictures of a coded snapshot with its restored cube, their PSFs and the true bands."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from labapp.common.figure_png import figure_to_png
from labapp.files.cubes import SpectralCube
from labapp.files.picture.photograph_writing import encode_srgb
from labapp.files.wavelengths import format_nanometres
from labapp.files.writing import encode_image
from labapp.spectral.colour import cube_to_linear_srgb
from labapp.spectral.lights import ViewingLight
from labapp.spectral.problem import WHITE_PERCENTILE
from labapp.spectral.restoration import RestoredCube

MOST_BANDS = 8
"""Most bands that a drawing shows side by side."""

_TITLE_WIDTH = 150  # characters of a line of the title

# Share of a PSF's light that is drawn, and least pixels from its middle.
_DRAWN_SHARE, _LEAST_REACH = 0.97, 8

_DECADES = 3  # powers of ten below its peak that a PSF is drawn over


def draw_snapshot(restored: RestoredCube, light: ViewingLight) -> bytes:
    """Draw a snapshot and the cube restored from it, and return the bytes of a PNG.

    Above are the snapshot and the cube's colours in a light, below each band with its PSF. Where
    the true cube is known, it is drawn beside them.
    """
    problem = restored.problem
    shown = shown_bands(len(problem.wavelengths))
    rows = 2 if restored.truth is None else 3
    width = max(2.0 * len(shown), 11.0)
    figure = Figure(figsize=(width, 4.6 + 2.2 * rows), dpi=110, layout="constrained")
    title = f"{problem.source}: {restored.image.method}, {restored.verdict}"
    figure.suptitle(textwrap.fill(title, _TITLE_WIDTH), fontsize=10)
    parts = figure.subfigures(2, 1, height_ratios=[4.2, 2.2 * rows], squeeze=False)
    _draw_colours(parts[0, 0], restored, light)
    _draw_bands(parts[1, 0], restored, shown)
    return figure_to_png(figure)


def encode_colours(path: Path, cube: SpectralCube, light: ViewingLight) -> bytes:
    """Return the bytes of a .png file with a cube's colours in a light, in sRGB."""
    return encode_image(path, srgb_levels(cube, light)[..., ::-1])


def srgb_levels(cube: SpectralCube, light: ViewingLight) -> NDArray[np.uint8]:
    """Compute the 8-bit sRGB levels of a cube's colours in a light, (rows, columns, 3).

    Colours out of sRGB's gamut are clipped.
    """
    return encode_srgb(cube_to_linear_srgb(cube, light))


def shown_bands(count: int) -> list[int]:
    """Return which bands are drawn: all, or `MOST_BANDS` evenly spaced ones."""
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_BANDS)).round())
    return [int(one) for one in chosen]


def _draw_colours(figure: SubFigure, restored: RestoredCube, light: ViewingLight) -> None:
    """Draw the photograph's bare pixels, and the colours of restored and true cube."""
    axes = figure.subplots(1, 3)
    rate = np.nan_to_num(restored.problem.rate)
    bright = float(np.percentile(rate, WHITE_PERCENTILE))
    axes[0].imshow(encode_srgb(rate / max(bright, 1e-300)), cmap="gray", vmin=0, vmax=255)
    _strip_ticks(axes[0], "Snapshot, bare pixels")
    axes[1].imshow(srgb_levels(restored.cube, light))
    scores = restored.scores
    apart = "" if scores is None else f", CIEDE2000 {scores.difference:.1f}"
    _strip_ticks(axes[1], f"Restored, in {light.name}{apart}")
    if restored.truth is not None:
        axes[2].imshow(srgb_levels(restored.truth, light))
        _strip_ticks(axes[2], f"True, in {light.name}")
        return
    axes[2].set_facecolor("0.25")
    drawn = axes[2].imshow(restored.residual_map, cmap="RdBu_r", vmin=-4.0, vmax=4.0)
    _strip_ticks(axes[2], "Unexplained, in units of the noise")
    figure.colorbar(drawn, ax=axes[2], shrink=0.85, pad=0.02)


def _draw_bands(figure: SubFigure, restored: RestoredCube, shown: list[int]) -> None:
    """Draw restored bands, true bands and PSFs, a column for each band."""
    problem = restored.problem
    axes = figure.subplots(2 if restored.truth is None else 3, len(shown), squeeze=False)
    reach = reach_of_light(problem.psfs, _DRAWN_SHARE)
    for column, band in zip(axes.T, shown, strict=True):
        name = format_nanometres(problem.wavelengths[band])
        level = "" if restored.scores is None else f"\n{restored.scores.bands[band].psnr:.1f} dB"
        _draw_band(column[0], restored.cube.values[band], f"{name}{level}")
        if restored.truth is not None:
            _draw_band(column[1], restored.truth.values[band], "true")
        psf = cut_middle(problem.psfs[band], reach)
        peak = float(psf.max())
        least = peak * 10.0**-_DECADES
        column[-1].imshow(np.maximum(psf, least), cmap="magma", norm=LogNorm(least, peak))
        _strip_ticks(column[-1], f"PSF, {len(psf)} pixels, {_DECADES} decades")


def _draw_band(axes: Axes, band: NDArray[np.float32], title: str) -> None:
    axes.imshow(encode_srgb(band), cmap="gray", vmin=0, vmax=255)
    _strip_ticks(axes, title)


def reach_of_light(psfs: NDArray[np.float64], share: float) -> int:
    """Return within how many pixels of its middle each PSF has a share of its light."""
    side = min(psfs.shape[1:]) // 2
    for reach in range(min(_LEAST_REACH, side), side):
        if all(cut_middle(one, reach).sum() >= share * one.sum() for one in psfs):
            return reach
    return side


def cut_middle(psf: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Return the part of a PSF within some pixels from its origin, n // 2."""
    rows, columns = (slice(max(n // 2 - reach, 0), n // 2 + reach + 1) for n in psf.shape)
    return psf[rows, columns]


def _strip_ticks(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=9)
    axes.set(xticks=[], yticks=[])
