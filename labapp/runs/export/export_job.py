"""The frames of an export, as the writers of files get them: images, columns and file names."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.plan_file import ROLES
from labapp.runs.readouts import Readout
from labapp.runs.record import layout
from labapp.runs.record.reader import Record
from optics.progress import Progress

_AT_ONCE = 1024
"""Rows that are made at once. Chosen: little memory, little loss."""


class FrameRows:
    """Rows of the exported frames, with names in place of the indices of names.

    They are kept as arrays, and made into rows while somebody goes through them.
    """

    def __init__(self, record: Record, frames: Sequence[int]) -> None:
        chosen = np.asarray(frames, np.intp)
        self.columns = (*layout.PLANNED, *layout.MEASURED)
        self._values = {name: record.column(name)[chosen] for name in self.columns}
        self._names: dict[str, Sequence[str]] = {
            "target": record.target_names,
            "pattern": record.pattern_names,
            "role": ROLES,
            "readout": [one.describe() or "whole frame" for one in record.readouts],
        }

    def __len__(self) -> int:
        return len(self._values["frame"])

    def __iter__(self) -> Iterator[dict[str, Any]]:
        blocks = zip(*(self.blocks(name) for name in self.columns), strict=True)
        for block in blocks:
            for row in zip(*block, strict=True):
                yield dict(zip(self.columns, row, strict=True))

    def blocks(self, name: str) -> Iterator[list[Any]]:
        """Yield a column in blocks of plain values."""
        names = self._names.get(name)
        for first in range(0, len(self), _AT_ONCE):
            values = self._values[name][first : first + _AT_ONCE].tolist()
            yield (
                values
                if names is None
                else [
                    names[value] if value < len(names) else f"unknown {value}" for value in values
                ]
            )

    def distinct(self, name: str) -> list[Any]:
        """Return the different values of a column of numbers."""
        return np.unique(self._values[name]).tolist()


def column_heading(name: str) -> str:
    """Return a column's heading in a table: its name with its unit."""
    unit = layout.UNITS.get(name, "").replace("/", "_per_")
    return f"{name}_{unit}" if unit else name


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


class ExportJob:
    """Exported frames: their pictures, their columns in the record, and file names."""

    def __init__(self, record: Record, kind: str, frames: list[int], progress: Progress) -> None:
        self.record, self.kind, self.frames, self._progress = record, kind, frames, progress
        self.rows = FrameRows(record, frames)
        self._first = frames[0] if frames else 0
        self.shape = record.frame_size(self._first)
        self.pitch = _pitch(record, record.readout_of(self._first))
        self.bits = _bits(record, record.readout_of(self._first))

    def names(self) -> Iterator[str]:
        """Yield the names of the files: of the frames in their order, the table last."""
        return file_names(self.kind, self.frames, self.rows, self.record.frame_count)

    @property
    def first_name(self) -> str:
        return next(self.names())

    def images(self) -> Iterator[NDArray[np.uint16]]:
        """Yield the frames, (rows, columns) each; raise Cancelled if cancelled."""
        for done, index in enumerate(self.frames):
            self._progress.report(done / len(self.frames), f"export frame {index}")
            yield self.record.stored_image(index)


def _pitch(record: Record, readout: Readout) -> tuple[float, float] | None:
    """Return the frames' pixel pitch (y, x) in metres; None if the axes are too short."""
    y, x = (record.column(name) * (readout.binning or 1) for name in ("y", "x"))
    if min(len(y), len(x)) < 2:
        return None
    # Rounding to 12 digits restores the bench's pitch from the rounded positions.
    pitch = (
        _round_digits((y[-1] - y[0]) / (len(y) - 1)),
        _round_digits((x[-1] - x[0]) / (len(x) - 1)),
    )
    return pitch if all(0 < one < math.inf for one in pitch) else None


def _round_digits(length: float) -> float:
    return float(f"{length:.12g}")


def _bits(record: Record, readout: Readout) -> int | None:
    """Return the bits per digital number; None if the recorded bench can't be read."""
    with suppress(UserError):
        return record.bench_as_opened.sensor.bits + readout.steps_per_dn.bit_length() - 1
    return None
