"""Export frames from the command line, with progress and a report of missing frames."""

from __future__ import annotations

from pathlib import Path

from labapp.common.console import out, terminal_progress
from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.files.frame_list import format_frame_list
from labapp.runs.export.exporting import ExportResult, export_frames
from labapp.runs.export.frame_selection import FrameSelection
from labapp.runs.export.naming import TABLE


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
