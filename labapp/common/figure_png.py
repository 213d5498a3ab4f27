"""Encode a Matplotlib figure as a PNG file, with its texts as they are."""

from __future__ import annotations

import io

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter

from labapp.common.drawing_mark import DRAWING
from labapp.common.plain_text import printable


def figure_to_png(figure: Figure) -> bytes:
    """Encode a figure as the bytes of a PNG file, for all packages of labapp."""
    show_plain_text(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=figure.dpi, metadata={"Description": DRAWING})
    return buffer.getvalue()


def show_plain_text(figure: Figure) -> None:
    """Let titles and labels of a labapp figure show names as they are; $ begins no formula.

    Numbers along the axes stay formulas, since Matplotlib writes powers of ten with them.
    """
    numbers = {text for axes in figure.findobj(Axes) for text in _formatted_numbers(axes)}
    for text in figure.findobj(Text):
        if text not in numbers:
            text.set_parse_math(False)
            text.set_text(printable(text.get_text()))


def _formatted_numbers(axes: Axes) -> set[Text]:
    """Return the texts of a labapp diagram's axes that Matplotlib writes itself."""
    found: set[Text] = set()
    for axis in (axes.xaxis, axes.yaxis):
        if not isinstance(axis.get_major_formatter(), FixedFormatter):
            found |= {*axis.get_ticklabels(which="both"), axis.get_offset_text()}
    return found
