"""Write the files of an export so that either all of them appear or none.

A power cut while they are moved may leave some, each of them whole.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.write_locks import move_into_place
from labapp.files.writing import create_folder, sync_all, sync_to_disk


@contextmanager
def all_or_none(folder: Path, names: Callable[[], Iterable[str]], *, force: bool) -> Iterator[Path]:
    """Yield a draft folder; its files move to `folder` together if the block succeeds.

    Files that are there are replaced with `force` only, and never while a run writes them. Raises
    UserError, and leaves no file of the export, if the disk refuses a file or the folder.

    names: gives the names of the files; there may be a million.
    """
    try:
        with _draft_folder(folder) as draft:
            yield draft
            sync_all(draft / name for name in names())
            _move_all(draft, folder, names, force)
    except OSError as error:
        # NumPy's error for an incomplete write gives counts of items, but no reason.
        reason = error.strerror or "the disk took less than it was given; it may be full"
        raise UserError(
            f"{folder}: cannot be written: {reason}. Nothing was exported; make space there, "
            "or choose another place."
        ) from error


def _move_all(draft: Path, folder: Path, names: Callable[[], Iterable[str]], force: bool) -> None:
    """Move the files to their folder; if one can't be moved, remove all."""
    moved = 0
    try:
        for name in names():
            move_into_place(draft / name, folder / name, force=force)
            moved += 1
        sync_to_disk(folder)
    except (OSError, UserError) as error:
        left = [name for name in islice(names(), moved) if not _remove(folder / name)]
        if left:
            reason = error.strerror if isinstance(error, OSError) else error
            raise UserError(
                f"{folder}: cannot be written: {reason}. {len(left)} files of the export couldn't "
                f"be removed again, such as {left[0]}. Look at the disk, and remove them."
            ) from error
        raise


def _remove(path: Path) -> bool:
    """Remove a file; return whether it is gone."""
    try:
        path.unlink()
    except OSError:
        return False
    return True


def _remove_left_drafts(folder: Path) -> None:
    """Remove the drafts of exports that were killed, or couldn't remove them."""
    for draft in folder.glob(".export.*.new"):
        pid = draft.name.split(".")[2]
        # No other process has this one's number.
        if pid.isdigit() and (pid == str(os.getpid()) or not Path("/proc", pid).exists()):
            shutil.rmtree(draft, ignore_errors=True)


@contextmanager
def _draft_folder(folder: Path) -> Iterator[Path]:
    """Yield a hidden draft folder within a folder, and remove it in any case."""
    is_new = not folder.exists()
    draft = None
    try:
        create_folder(folder)
        _remove_left_drafts(folder)
        draft = Path(tempfile.mkdtemp(".new", f".export.{os.getpid()}.", folder))
        yield draft
    finally:
        if draft is not None:
            shutil.rmtree(draft, ignore_errors=True)
        if is_new:
            # This removes the folder only if it is empty.
            with suppress(OSError):
                folder.rmdir()
