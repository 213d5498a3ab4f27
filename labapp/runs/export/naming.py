"""The names of the files that an export writes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from labapp.runs.export.frame_rows import FrameRows

TABLE = "frames.csv"

ONE_FILE_PER_FRAME = ("tiff", "png")
"""Kinds of which every frame is a file."""

_NAME_BYTES = 60
"""Of a target's or pattern's name in a file's name: file systems take 255 for the whole."""


def file_names(kind: str, frames: Sequence[int], rows: FrameRows, total: int) -> list[str]:
    """What an export writes; of tiff and png the pictures first, one a frame.

    rows: of these frames. total: how many frames the record has.
    """
    if kind == "npy":
        return ["frames.npy", "frames.json", TABLE]
    if kind == "ome-tiff":
        return ["frames.ome.tiff", TABLE]
    # All with as many digits, so that they sort.
    digits = max(5, len(str(total - 1)))
    named = [f"{i:0{digits}}_{_frame_name(row)}" for i, row in zip(frames, rows, strict=True)]
    return [*(f"{name}.{kind}" for name in named), TABLE]


def format_decimal(value: float) -> str:
    """A number with three decimals at most, never with an exponent."""
    return f"{value:.3f}".rstrip("0").rstrip(".")


def _frame_name(row: dict[str, Any]) -> str:
    """What a frame shows, for its file's name."""
    nm, ms = row["wavelength_asked"] * 1e9, row["exposure_asked"] * 1e3
    names = f"{_plain(row['target'])}_{_plain(row['pattern'])}"
    return f"{names}_{format_decimal(nm)}nm_{format_decimal(ms)}ms"


def _plain(name: str) -> str:
    """A name with only letters, digits and what no file system dislikes, and not too long."""
    plain = re.sub(r"[^\w.+-]", "-", name)
    return plain.encode()[:_NAME_BYTES].decode(errors="ignore")
