"""Export frames of a record: select them, read them back, write the files, report what lacks."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import count, repeat
from pathlib import Path

import numpy as np

from labapp.common.console import out, terminal_progress
from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.files.frame_list import format_frame_list, read_frame_list
from labapp.files.writing import require_free_names
from labapp.runs.export.atomic_files import all_or_none
from labapp.runs.export.export_job import ONE_FILE_PER_FRAME, TABLE, ExportJob, column_heading
from labapp.runs.export.npy import write_npy
from labapp.runs.export.ome_tiff import write_ome_tiff
from labapp.runs.export.single_files import write_pngs, write_tiffs
from labapp.runs.record.reader import Record
from optics.progress import Progress


@dataclass(frozen=True)
class FrameSelection:
    """Criteria for frames to export, of which those that aren't None must all be met.

    Parameters
    ----------
    frames : str, optional
        List of frame indices, such as "0-9,12".
    target : str, optional
        Name of a target.
    pattern : str, optional
        Name of a pattern.
    readout : int, optional
        Number of a way in which the sensor was read, from 0.
    """

    frames: str | None = None
    target: str | None = None
    pattern: str | None = None
    readout: int | None = None


def select_frames(record: Record, selection: FrameSelection) -> list[int]:
    """Return the indices of the frames that meet the criteria, stored or not.

    Raises UserError if there are none.
    """
    total = record.frame_count
    keep = np.full(total, selection.frames is None)
    if selection.frames is not None:
        keep[read_frame_list(selection.frames, total)] = True
    known = {"target": record.target_names, "pattern": record.pattern_names}
    for column, names in known.items():
        name = getattr(selection, column)
        if name is None:
            continue
        if name not in names:
            raise UserError(f"--{column}: {name!r} is none of the record's: {', '.join(names)}.")
        keep &= record.column(column) == names.index(name)
    if selection.readout is not None:
        keep &= record.column("readout") == record.chosen_readout
    if not keep.any():
        raise UserError(f"{record.path}: no frame is all that was asked for. Ask for less.")
    return np.flatnonzero(keep).tolist()


WRITERS: dict[str, Callable[[ExportJob, Path], None]] = {
    "tiff": write_tiffs,
    "png": write_pngs,
    "ome-tiff": write_ome_tiff,
    "npy": write_npy,
}
"""Functions by kind that write all files but the table of frames into a folder."""

KINDS = tuple(WRITERS)

_ALL = FrameSelection()


@dataclass(frozen=True)
class ExportResult:
    """What was exported: indices of the written frames, and of those left out.

    bits: of the digital numbers; None if unknown.
    """

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
    """Export frames of a record to files in a folder, with a table of the frames.

    Digital numbers are never changed. Frames that aren't stored, or don't read back as they were
    stored, are left out. All files appear together when the last one is complete, so a cancelled
    export leaves none.

    Parameters
    ----------
    path : Path
        File of the record.
    kind : str
        One of KINDS. "tiff" and "png" write one 16-bit picture per frame. "ome-tiff" writes
        frames.ome.tiff with axes TYX. "npy" writes frames.npy, (n, rows, columns) uint16, and
        frames.json.
    folder : Path
        Folder of the files, which is made if it doesn't exist.
    selection : FrameSelection
        The frames to export; all frames by default.
    force : bool
        Whether existing files may be replaced.
    progress : Progress, optional
        Reports the progress, and can cancel the export.

    Returns
    -------
    ExportResult
        The frames that were written, and those that were left out.

    Raises
    ------
    UserError
        If no frame is selected, or the record can't be read, or the files can't be written.
    Cancelled
        If the progress was cancelled.
    """
    progress = progress or Progress()
    if kind not in KINDS:
        raise UserError(f"--to: {kind!r} is none of {', '.join(KINDS)}.")
    with Record(path, readout=selection.readout) as record:
        chosen = select_frames(record, selection)
        if kind not in ONE_FILE_PER_FRAME and not _are_alike(record, chosen):
            raise UserError(
                f"--to {kind}: one file has frames of one size and unit. Choose some by --readout, "
                "or export tiff or png."
            )
        require_free_names(folder, ExportJob(record, kind, chosen, progress).names(), force=force)
        # Reading all frames back, before the first is written, has 30 % of the progress.
        reading, writing = progress.part(0, 0.3), progress.part(0.3, 1)
        found, not_stored, damaged = record.read_back(chosen, reading)
        # Of a million frames, the list takes as much as half of their columns.
        del chosen
        work = ExportJob(record, kind, found, writing)
        if found:
            with all_or_none(folder, work.names, force=force) as draft:
                WRITERS[kind](work, draft)
                _write_table(work, draft)
        return ExportResult(found, not_stored, damaged, work.bits)


def _are_alike(record: Record, frames: list[int]) -> bool:
    """Return whether frames have one size, and one unit of their numbers."""
    _, first = np.unique(record.column("readout")[frames], return_index=True)
    some = [frames[place] for place in first.tolist()]
    alike = {(record.frame_size(one), record.readout_of(one).steps_per_dn) for one in some}
    return len(alike) == 1


def _write_table(work: ExportJob, draft: Path) -> None:
    """Write the table of frames: each one's file, place in the file, and columns."""
    simulated = " ".join(work.record.simulated_devices)
    with (draft / TABLE).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        headings = [column_heading(name) for name in work.rows.columns]
        writer.writerow(["file", "place", *headings, "simulated"])
        if work.kind in ONE_FILE_PER_FRAME:
            places: Iterable[tuple[str, int]] = ((name, 0) for name in work.names())
        else:
            places = zip(repeat(work.first_name), count(), strict=False)
        for place, row in zip(places, work.rows, strict=False):
            writer.writerow([*place, *row.values(), simulated])


def export_record(
    path: Path, kind: str, folder: Path, selection: FrameSelection, *, force: bool
) -> None:
    """Export frames of a record, print what was written, and report missing frames.

    Parameters
    ----------
    path : Path
        File of the record.
    kind : str
        Kind of the files, one of KINDS.
    folder : Path
        Folder of the files, which is made if it doesn't exist.
    selection : FrameSelection
        The frames to export.
    force : bool
        Whether existing files may be replaced.

    Raises
    ------
    UserError
        If requested frames are missing; the others have then been exported. Also for the reasons
        of export_frames().
    """
    with terminal_progress() as progress:
        done = export_frames(path, kind, folder, selection, force=force, progress=progress)
    if done.frames:
        out.print(f"wrote {len(done.frames)} frames to {folder}, and {TABLE}")
    if done.frames and done.bits is not None and done.bits < 16 and kind != "npy":
        out.print(f"raw numbers of {done.bits} bits, not scaled: viewers may show them dark")
    _require_all(done, path)


def _require_all(done: ExportResult, record: Path) -> None:
    """Raise UserError with the requested frames that were left out, if any."""
    told = []
    if done.not_stored:
        told.append(f"never stored: {format_frame_list(done.not_stored)}")
    if done.damaged:
        told.append(f"stored, but damaged since: {format_frame_list(done.damaged)}")
    if told:
        raise UserError(
            f"{record}: {len(done.not_stored) + len(done.damaged)} frames are missing and "
            f"were left out ({'; '.join(told)}). To take them: labapp resume {shell_word(record)}"
        )
