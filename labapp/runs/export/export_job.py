"""The frames of an export with their metadata, as the writer of each file format gets them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.runs.export.frame_rows import FrameRows
from labapp.runs.export.naming import file_names
from labapp.runs.readouts import Readout
from labapp.runs.record.reader import Record
from optics.progress import Progress


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
