"""Encode a Matplotlib figure as a PNG file."""

from __future__ import annotations

import io

from matplotlib.figure import Figure


def figure_to_png(figure: Figure) -> bytes:
    """Encode a figure as the bytes of a PNG file, for all packages of labapp."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=figure.dpi)
    return buffer.getvalue()
