"""The picture of a pattern's design: target, pattern and predicted PSF."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.common.figure_png import figure_to_png
from labapp.files.design_file import Grid
from labapp.patterns.designing.pattern_design import PatternDesign


def draw_design(title: str, notes: str, design: PatternDesign) -> bytes:
    """Draw a design as PNG: pattern, target, linear and logarithmic PSF of each moment.

    Of a target that changes with time, at most 4 moments are drawn, among them first and last.
    """
    count = len(design.psf.images)
    rows = np.unique(np.linspace(0, count - 1, min(count, 4)).round().astype(int))
    widths = [1.78, 1.0, 1.0] if design.target is None else [1.78, 1.0, 1.0, 1.0]
    size = (3.9 * sum(widths), 4.0 * len(rows) + 0.9)
    figure = Figure(figsize=size, dpi=100, layout="constrained")
    figure.suptitle(f"{title}\n{notes}", fontsize=12)
    axes = figure.subplots(len(rows), len(widths), squeeze=False, width_ratios=widths)
    for row, moment in zip(axes, rows, strict=True):
        _row(list(row), design, int(moment), count)
    return figure_to_png(figure)


def _row(axes: list[Axes], design: PatternDesign, moment: int, count: int) -> None:
    grey = design.greys[moment * len(design.greys) // count]
    which = f", moment {moment + 1} of {count}" if count > 1 else ""
    axes[0].imshow(grey, cmap="gray", interpolation="nearest")
    axes[0].set_title(f"Pattern (grey {grey.min()} to {grey.max()}){which}")
    axes[0].set(xticks=[], yticks=[])
    psf, target = design.psf.images[moment], design.target
    if target is not None:
        _draw(axes[1], target, target.images[moment], "Target")
        # The target is drawn over the same part of the sensor as the PSF beside it.
        axes[1].set_xlim(*_sample_edges(design.psf.x))
        axes[1].set_ylim(*reversed(_sample_edges(design.psf.y)))
        axes[1].set_facecolor("black")
    brightest = _white_level(psf, target is not None)
    clipped = ", brighter centre clipped" if brightest < psf.max() else ""
    _draw(axes[-2], design.psf, psf, f"Predicted PSF{clipped}", Normalize(0, brightest))
    peak = max(float(psf.max()), np.finfo(np.float64).tiny)
    lowest = peak * 1e-4
    _draw(
        axes[-1],
        design.psf,
        np.maximum(psf, lowest),
        "Predicted PSF, 4 decades",
        LogNorm(lowest, peak),
    )


def _white_level(psf: NDArray[np.float64], has_target: bool) -> float:
    """Return the brightness that is drawn as white: the PSF's peak.

    If the pattern has a target, the pixels within 4 of the axis, where unmodulated light falls, are
    left out.
    """
    rest = psf.copy()
    if has_target:
        middle = tuple(slice(max(n // 2 - 4, 0), n // 2 + 5) for n in psf.shape)
        rest[middle] = 0
    return float(rest.max()) or float(psf.max()) or 1.0


def _draw(
    axes: Axes, grid: Grid, values: NDArray[np.float64], title: str, norm: Normalize | None = None
) -> None:
    (left, right), (top, bottom) = _sample_edges(grid.x), _sample_edges(grid.y)
    extent = (left, right, bottom, top)
    axes.imshow(values, cmap="magma", norm=norm, extent=extent, interpolation="nearest")
    axes.set_title(title)
    axes.set_xlabel("µm on the sensor")


def _sample_edges(place: NDArray[np.float64]) -> tuple[float, float]:
    """Return the outer edges of the first and last sample in µm, from centres in metres."""
    half = (place[-1] - place[0]) / max(len(place) - 1, 1) / 2
    return float(place[0] - half) * 1e6, float(place[-1] + half) * 1e6
