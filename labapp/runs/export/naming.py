"""Name the files that an export writes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

from labapp.runs.export.frame_rows import FrameRows

TABLE = "frames.csv"

ONE_FILE_PER_FRAME = ("tiff", "png")
"""Kinds of exports that write one file per frame."""

_SINGLE_FILES = {"npy": ("frames.npy", "frames.json"), "ome-tiff": ("frames.ome.tiff",)}
"""Files of the other kinds, that with the frames first."""


def file_names(kind: str, frames: Sequence[int], rows: FrameRows, total: int) -> Iterator[str]:
    """Yield the names of the files that are written, the table last.

    rows: one per exported frame.
    total: number of frames in the record.
    """
    yield from _SINGLE_FILES.get(kind, ())
    if kind in ONE_FILE_PER_FRAME:
        # All frame numbers have the same number of digits, so that the names sort.
        digits = max(5, len(str(total - 1)))
        for index, row in zip(frames, rows, strict=True):
            yield f"{index:0{digits}}_{_frame_name(row)}.{kind}"
    yield TABLE


def format_decimal(value: float) -> str:
    """Format a number for a file name: at most 3 decimals, no exponent."""
    return f"{value:.3f}".rstrip("0").rstrip(".")


def _frame_name(row: dict[str, Any]) -> str:
    """Return the part of a file name that describes the shot's settings."""
    nm, ms = row["wavelength_asked"] * 1e9, row["exposure_asked"] * 1e3
    names = f"{_plain(row['target'])}_{_plain(row['pattern'])}"
    return f"{names}_{format_decimal(nm)}nm_{format_decimal(ms)}ms"


def _plain(name: str) -> str:
    """Adapt a target's or pattern's name to file names.

    They allow few characters and have a limited length.
    """
    plain = re.sub(r"[^\w.+-]", "-", name)
    # File systems allow 255 bytes for the whole name, which holds two such names.
    return plain.encode()[:60].decode(errors="ignore")
