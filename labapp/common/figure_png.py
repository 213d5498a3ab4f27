"""Encode a Matplotlib figure as a PNG file."""

from __future__ import annotations

import io

from matplotlib.figure import Figure


def figure_to_png(figure: Figure) -> bytes:
    """Return a figure as bytes of a PNG file, a helper common to all of labapp."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=figure.dpi)
    return buffer.getvalue()
