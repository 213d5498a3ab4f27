"""From a figure to the bytes of a picture's file."""

from __future__ import annotations

import io

from matplotlib.figure import Figure


def figure_to_png(figure: Figure) -> bytes:
    """A figure as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=figure.dpi)
    return buffer.getvalue()
