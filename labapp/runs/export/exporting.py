"""An export from beginning to end: choose, check the place, read back, write."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.writing import require_free_names
from labapp.runs.export.atomic_files import all_or_none
from labapp.runs.export.export_job import ExportJob
from labapp.runs.export.frame_rows import column_heading, frame_rows
from labapp.runs.export.frame_selection import FrameSelection, select_frames
from labapp.runs.export.naming import ONE_FILE_PER_FRAME, TABLE, file_names
from labapp.runs.export.npy import write_npy
from labapp.runs.export.ome_tiff import write_ome_tiff
from labapp.runs.export.single_files import write_pngs, write_tiffs
from labapp.runs.record.reader import Record
from optics.progress import Progress

WRITERS: dict[str, Callable[[ExportJob, Path], None]] = {
    "tiff": write_tiffs,
    "png": write_pngs,
    "ome-tiff": write_ome_tiff,
    "npy": write_npy,
}
"""By kind; each writes the work's files, but for the table of the frames, into a folder."""

KINDS = tuple(WRITERS)

_ALL = FrameSelection()

_CHECKING = 0.3
"""Share of the progress that goes into reading every frame back before the first is written."""


@dataclass(frozen=True)
class ExportResult:
    """What was written: frames by index, and which had to be left out. bits: of the numbers."""

    frames: list[int]
    not_stored: list[int]
    damaged: list[int]
    bits: int | None


def export_frames(
    path: Path,
    kind: str,
    folder: Path,
    selection: FrameSelection = _ALL,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> ExportResult:
    """Write frames of a record into a folder, which is made if need be.

    kind: of KINDS. tiff, png: a 16-bit picture a frame; ome-tiff: one frames.ome.tiff, axes
    TYX; npy: frames.npy (n, rows, columns) uint16, and frames.json. Digital numbers are
    never changed. With every kind comes a table of the frames. Frames that aren't stored or
    don't read back are left out. Files appear all together when the last one is whole:
    whoever cancels finds none. UserError if nothing can be chosen, read or written.
    """
    progress = progress or Progress()
    if kind not in KINDS:
        raise UserError(f"--to: {kind!r} is none of {', '.join(KINDS)}.")
    with Record(path) as record:
        chosen = select_frames(record, selection)
        names = file_names(kind, chosen, frame_rows(record, chosen), record.frame_count)
        require_free_names(folder, names, force=force)
        found, not_stored, damaged = record.read_back(chosen, progress.part(0, _CHECKING))
        work = ExportJob(record, kind, found, progress.part(_CHECKING, 1))
        if found:
            _write(work, folder)
        return ExportResult(found, not_stored, damaged, work.bits)


def _write(work: ExportJob, folder: Path) -> None:
    """The files of an export, all of them or none."""
    with all_or_none(folder, work.names) as draft:
        WRITERS[work.kind](work, draft)
        _write_table(work, draft)


def _write_table(work: ExportJob, draft: Path) -> None:
    """A line a frame: its file, its place in it, all columns, and what was simulated."""
    simulated = " ".join(work.record.simulated_devices)
    with (draft / TABLE).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        headings = [column_heading(name) for name in work.rows[0]]
        writer.writerow(["file", "place", *headings, "simulated"])
        for place, row in enumerate(work.rows):
            at = (
                (work.names[place], 0)
                if work.kind in ONE_FILE_PER_FRAME
                else (work.names[0], place)
            )
            writer.writerow([*at, *row.values(), simulated])
