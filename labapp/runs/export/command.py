"""What a person sees of an export: how far it is, what was written, what is missing."""

from __future__ import annotations

from pathlib import Path

from labapp.common.console import out, watched
from labapp.common.errors import UserError
from labapp.files.frame_list import frame_list
from labapp.runs.export.choosing import Choice
from labapp.runs.export.exporting import Exported, export
from labapp.runs.export.naming import TABLE


def export_record(path: Path, kind: str, folder: Path, choice: Choice, *, force: bool) -> None:
    """Export frames, say what was written, and raise UserError if frames are missing."""
    with watched() as progress:
        done = export(path, kind, folder, choice, force=force, progress=progress)
    if done.frames:
        out.print(f"wrote {len(done.frames)} frames to {folder}, and {TABLE}", markup=False)
    if done.frames and done.bits is not None and done.bits < 16 and kind != "npy":
        out.print(f"raw numbers of {done.bits} bits, not scaled: viewers may show them dark")
    _require_all(done, path)


def _require_all(done: Exported, record: Path) -> None:
    """UserError that names the frames that were asked for and aren't there."""
    told = []
    if done.not_stored:
        told.append(f"never stored: {frame_list(done.not_stored)}")
    if done.damaged:
        told.append(f"stored, but damaged since: {frame_list(done.damaged)}")
    if told:
        raise UserError(
            f"{record}: {len(done.not_stored) + len(done.damaged)} frames are missing and "
            f"were left out ({'; '.join(told)}). To take them: labapp resume {record}"
        )
