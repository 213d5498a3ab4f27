"""Encode a Matplotlib figure as a PNG file."""

from __future__ import annotations

import io

from matplotlib.figure import Figure


def figure_to_png(figure: Figure) -> bytes:
    """Return the bytes of a PNG file of a figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=figure.dpi)
    return buffer.getvalue()
