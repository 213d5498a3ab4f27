"""Pictures on a plate, each without ticks."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from numpy.typing import NDArray

_DECADES = 1e-4


def draw_tone(axes: Axes, picture: NDArray[Any], title: str, white: float | None = None) -> None:
    """Linear from black to white, or to the 99.8th percentile."""
    top = float(np.percentile(picture, 99.8)) if white is None else white
    axes.imshow(picture, cmap="magma", vmin=0, vmax=top or 1, interpolation="nearest")
    _bare(axes, title)


def draw_log(axes: Axes, picture: NDArray[Any], title: str, peak: float | None = None) -> None:
    """Four decades below the peak."""
    top = max(float(picture.max()) if peak is None else peak, np.finfo(np.float64).tiny)
    shown = np.maximum(picture, top * _DECADES)
    axes.imshow(shown, cmap="magma", norm=LogNorm(top * _DECADES, top), interpolation="nearest")
    _bare(axes, title)


def draw_grey(axes: Axes, picture: NDArray[Any], title: str, white: float) -> None:
    """A photograph, as a screen shows it: gamma 2.2."""
    shown = np.clip(picture / white, 0, 1) ** (1 / 2.2)
    axes.imshow(shown, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    _bare(axes, title)


def draw_panel(axes: Axes, grey: NDArray[np.uint8], title: str) -> None:
    """A pattern of grey levels."""
    axes.imshow(grey, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    _bare(axes, title)


def _bare(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=11)
    axes.set_xticks([])
    axes.set_yticks([])
