"""The command `labapp salvage`: save the whole frames of a damaged record into a new one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from labapp.common.console import out, print_json, terminal_progress
from labapp.common.errors import UserError
from labapp.files.file_lookup import require_file
from labapp.runs.record.creation import create_record
from labapp.runs.record.salvage import DamagedRecord, Remains, open_damaged
from labapp.runs.record.writer import RecordWriter
from labapp.runs.state import State
from optics.progress import Progress


@dataclass(frozen=True)
class Salvage:
    """What was saved of a damaged record.

    lacks: what is lost, in words.
    digest: of the new record.
    """

    path: Path
    saved: int
    planned: int
    lacks: list[str]
    digest: str


def salvage_record(path: Path, new: Path, *, force: bool, as_json: bool) -> None:
    """Save the whole frames of a damaged record into a new one, and print what is lost.

    Raises UserError if nothing can be saved, or the new record can't be written.
    """
    with terminal_progress() as progress:
        done = salvage(path, new, force=force, progress=progress)
    if as_json:
        print_json(
            {
                "record": str(done.path), "saved": done.saved, "planned": done.planned,
                "lacks": done.lacks, "digest": done.digest,
            }
        )  # fmt: skip
        return
    out.print(f"{new}: {done.saved} of {done.planned} frames saved", markup=False, soft_wrap=True)
    for one in done.lacks:
        out.print(f"lost: {one}", markup=False, soft_wrap=True)
    out.print(f"digest {done.digest}", markup=False, soft_wrap=True)


def salvage(
    path: Path, new: Path, *, force: bool = False, progress: Progress | None = None
) -> Salvage:
    """Save the whole frames into a new file; the damaged one isn't changed.

    Raises UserError if nothing can be saved, or the new record can't be written.
    """
    progress = progress or Progress()
    require_file(path)
    if path.resolve() == new.resolve():
        raise UserError(f"{new}: is the damaged record itself. Name another file.")
    with open_damaged(path) as damaged:
        found = damaged.find_remains(progress.part(0, 0.5))
        if not found.whole:
            raise UserError(f"{path}: no frame is whole, so there is nothing to save.")
        writer = RecordWriter(new, create_record(new, found.contents, force=force))
        try:
            digest = _copy(damaged, found, path, writer, progress.part(0.5, 1))
        except OSError as error:
            raise UserError(
                f"{new}: isn't on the disk: {error.strerror}. {path} is as it was; save its frames "
                "on another disk."
            ) from error
    return Salvage(new, len(found.whole), len(found.contents.shots), found.lacks, digest)


def _copy(
    damaged: DamagedRecord, found: Remains, path: Path, writer: RecordWriter, progress: Progress
) -> str:
    """Copy the frames and the log; return the digest of the new record."""
    with writer:
        for time, text in damaged.log_lines():
            writer.log(time, text)
        for done, index in enumerate(found.whole):
            progress.report(done / len(found.whole), f"save frame {index}")
            progress.raise_if_cancelled()
            image, settings = damaged.frame(index)
            writer.store_values(index, image, settings)
        for lost in found.lacks:
            writer.log(0.0, f"salvage: lost {lost}")
        message = f"salvaged from {path.name}; lost: {'; '.join(found.lacks) or 'nothing'}"
        return writer.set_state(State.FAILED, message)
