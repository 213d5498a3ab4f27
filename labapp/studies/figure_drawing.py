"""Draw pictures into figures without ticks, and encode animations of PSFs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.files.cubes import SpectralCube
from labapp.spectral.drawing import srgb_levels
from labapp.spectral.lights import ViewingLight


def draw_linear(axes: Axes, picture: NDArray[Any], title: str, white: float | None = None) -> None:
    """Draw a picture on a linear scale up to `white`, or to its 99.8th percentile."""
    top = float(np.percentile(picture, 99.8)) if white is None else white
    axes.imshow(picture, cmap="magma", vmin=0, vmax=top or 1, interpolation="nearest")
    _bare(axes, title)


def draw_log(axes: Axes, picture: NDArray[Any], title: str, peak: float | None = None) -> None:
    """Draw a picture on a logarithmic scale over four decades below the peak."""
    top = max(float(picture.max()) if peak is None else peak, np.finfo(np.float64).tiny)
    floor = top * 1e-4
    shown = np.maximum(picture, floor)
    axes.imshow(shown, cmap="magma", norm=LogNorm(floor, top), interpolation="nearest")
    _bare(axes, title)


def draw_photograph(axes: Axes, picture: NDArray[Any], title: str, white: float) -> None:
    """Draw a photograph with a screen's gamma of 2.2."""
    shown = np.clip(picture / white, 0, 1) ** (1 / 2.2)
    axes.imshow(shown, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    _bare(axes, title)


def draw_pattern(axes: Axes, grey: NDArray[np.uint8], title: str) -> None:
    """Draw a pattern's grey levels, black at 0 and white at 255."""
    axes.imshow(grey, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    _bare(axes, title)


def draw_colours(axes: Axes, cube: SpectralCube, light: ViewingLight, title: str) -> None:
    """Draw a cube's colours in a light, as sRGB."""
    axes.imshow(srgb_levels(cube, light), interpolation="nearest")
    _bare(axes, title)


def encode_gif(pictures: Sequence[NDArray[Any]]) -> bytes:
    """Encode pictures as a looping GIF: five per second, over four decades of light."""
    peak = max(float(picture.max()) for picture in pictures)
    figure = Figure(figsize=(4.2, 4.2), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "movie.gif"
        writer = PillowWriter(fps=5)
        with writer.saving(figure, path, dpi=100):
            for picture in pictures:
                axes.clear()
                draw_log(axes, picture, "", peak)
                writer.grab_frame()
        return path.read_bytes()


def _bare(axes: Axes, title: str) -> None:
    axes.axis("on")
    axes.set_title(title, fontsize=11)
    axes.set(xticks=[], yticks=[])
