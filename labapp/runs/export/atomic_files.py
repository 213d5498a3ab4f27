"""Files that take their names only when all of them are whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from labapp.common.errors import UserError


@contextmanager
def all_or_none(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """A place to write files to, which move into `folder` when the block ends without error.

    UserError, and no file, if what is written there or the folder itself is refused.
    """
    try:
        with _draft_folder(folder) as draft:
            yield draft
            for name in names:
                os.replace(draft / name, folder / name)
    except OSError as error:
        # numpy counts what was written, and doesn't say why it wasn't all.
        reason = error.strerror or "the disk took less than it was given; it may be full"
        raise UserError(
            f"{folder}: cannot be written: {reason}. Nothing was exported; make space there, "
            "or choose another place."
        ) from error


@contextmanager
def _draft_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder in the one that is written to; nothing stays in it, whatever happens."""
    is_new = not folder.exists()
    draft = folder / f".export.{os.getpid()}.new"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir()
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)
        if is_new:
            # Only if it is empty.
            with suppress(OSError):
                folder.rmdir()
