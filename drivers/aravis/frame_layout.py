"""Find where the lines of a frame stand in its bytes, as its leader and size tell."""

from __future__ import annotations

from typing import Any

from drivers.aravis.arrivals import BadFrame
from drivers.aravis.byte_checks import WIDER
from drivers.aravis.pixel_formats import PixelFormat

_ALIGNMENT = 4096
"""Bytes up to which the end of a frame may be filled up. Chosen; cameras fill up to packets."""


def line_distance(note: dict[str, Any], form: PixelFormat, shape: tuple[int, int]) -> int:
    """Return the bytes from a line to the next; 0 if they follow without a gap.

    BadFrame if the frame's size doesn't fit its shape (rows, columns).
    """
    rows, columns = shape
    line, needed, size = form.byte_count((1, columns)), form.byte_count(shape), note["size"]
    padding = note.get("padding", [0, 0])[0]
    if padding and size >= rows * (line + padding) - padding:
        return int(line + padding)
    if size == needed or (note.get("chunks") and size > needed):
        return 0
    if columns % form.group and size == rows * line:
        return line
    words = f"number {note['number']} has {size} bytes, and {shape[1]} x {shape[0]} pixels of "
    words += f"{form.name} have {needed}"
    if size < needed or padding:
        advice = width_advice(form, columns)
        raise BadFrame("corrupt", words, advice)
    more = size - needed
    if more % rows == 0:
        words += f": its lines seem to have {more // rows} bytes of padding that it doesn't tell"
        raise BadFrame("impossible", words, WIDER)
    if more >= _ALIGNMENT:
        remedy = "Look at the camera's pixel format, and its chunk and compression settings"
        raise BadFrame("impossible", words, remedy)
    return 0


def width_advice(form: PixelFormat, columns: int) -> str:
    """Return what to change if lines end within a byte; empty if they don't."""
    if columns % form.group == 0:
        return ""
    wider = -(-columns // form.group) * form.group
    return (
        f"{form.name} has {form.group} pixels in whole bytes, and {columns} aren't a multiple: "
        f"give a roi {wider} or {wider - form.group} pixels wide"
        if wider > form.group
        else f"{form.name} has {form.group} pixels in whole bytes: give a roi {wider} pixels wide"
    )
