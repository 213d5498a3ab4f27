"""Encodes a Matplotlib figure as a PNG file, with its texts as they are."""

from __future__ import annotations

import io
from collections.abc import Iterator

from matplotlib.artist import Artist
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter

from labapp.common.drawing_mark import DRAWING
from labapp.common.plain_text import printable


def figure_to_png(figure: Figure) -> bytes:
    """Encode a figure as the bytes of a PNG file that is marked as a drawing."""
    show_plain_text(figure)
    buffer = io.BytesIO()
    # Figure.savefig would draw a figure twice that Matplotlib lays out.
    canvas = FigureCanvasAgg(figure)
    canvas.print_png(buffer, metadata={"Description": DRAWING})  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def show_plain_text(figure: Figure) -> None:
    """Let titles and labels show names as they are; $ begins no formula.

    Numbers along the axes stay formulas, since Matplotlib writes powers of ten with them.
    """
    for text in _own_texts(figure):
        text.set_parse_math(False)
        text.set_text(printable(text.get_text()))


def _own_texts(artist: Artist) -> Iterator[Text]:
    """Yield the texts that Matplotlib doesn't write itself."""
    if isinstance(artist, Text):
        yield artist
    if isinstance(artist, Axis) and not isinstance(artist.get_major_formatter(), FixedFormatter):
        # Not its numbers, of which a logarithmic scale has hundreds that are never drawn.
        yield artist.label
        return
    for part in artist.get_children():
        yield from _own_texts(part)
