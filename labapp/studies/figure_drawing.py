"""Pictures on a plate, each without ticks."""

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

_LOG_FLOOR = 1e-4


def draw_linear(axes: Axes, picture: NDArray[Any], title: str, white: float | None = None) -> None:
    """Linear from black to white, or to the 99.8th percentile."""
    top = float(np.percentile(picture, 99.8)) if white is None else white
    axes.imshow(picture, cmap="magma", vmin=0, vmax=top or 1, interpolation="nearest")
    _bare(axes, title)


def draw_log(axes: Axes, picture: NDArray[Any], title: str, peak: float | None = None) -> None:
    """Four decades below the peak."""
    top = max(float(picture.max()) if peak is None else peak, np.finfo(np.float64).tiny)
    shown = np.maximum(picture, top * _LOG_FLOOR)
    axes.imshow(shown, cmap="magma", norm=LogNorm(top * _LOG_FLOOR, top), interpolation="nearest")
    _bare(axes, title)


def draw_photograph(axes: Axes, picture: NDArray[Any], title: str, white: float) -> None:
    """A photograph, as a screen shows it: gamma 2.2."""
    shown = np.clip(picture / white, 0, 1) ** (1 / 2.2)
    axes.imshow(shown, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    _bare(axes, title)


def draw_pattern(axes: Axes, grey: NDArray[np.uint8], title: str) -> None:
    """A pattern of grey levels."""
    axes.imshow(grey, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    _bare(axes, title)


def encode_gif(pictures: Sequence[NDArray[Any]]) -> bytes:
    """A GIF file that shows pictures in turn, five a second, again and again; four decades."""
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
