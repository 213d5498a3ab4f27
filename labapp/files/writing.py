"""Atomic writing of outputs, which never replaces a file without permission."""

from __future__ import annotations

import errno
import io
import logging
import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labapp.common.errors import UserError
from labapp.files.write_locks import move_into_place, name_draft, require_unlocked

if TYPE_CHECKING:
    from numpy.typing import NDArray

log = logging.getLogger(__name__)

_NO_SYNC = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTTY)
"""Errors of fsync(2) for what can't be synchronised; others mean that data were lost."""


_SYNCS = 8
"""Paths that are brought to the disk at once: four times as quick as one by one. Chosen."""


def require_writable(path: Path, *, force: bool) -> None:
    """Raise UserError if a path is taken and `force` isn't set, or it can't be written.

    A file that a run writes can't be replaced, with or without `force`.
    """
    folder = path.parent
    if path.is_dir():
        raise UserError(f"{path}: is a folder. Name a file in it.")
    if path.exists() and not path.is_file():
        raise UserError(f"{path}: isn't a plain file. Choose another name.")
    require_unlocked(path)
    if path.exists() and not force:
        raise UserError(f"{path}: exists already. Choose another name, or add --force.")
    if not folder.is_dir():
        raise UserError(f"{folder}: is not a folder. Make it first, or choose another place.")
    if not os.access(folder, os.W_OK):
        raise UserError(f"{folder}: may not be written to. Choose another place.")


def require_all_writable(paths: Iterable[Path | None], *, force: bool) -> None:
    """Raise UserError as require_writable() does, for each path that isn't None."""
    for path in paths:
        if path is not None:
            require_writable(path, force=force)


def require_free_names(folder: Path, names: Iterable[str], *, force: bool) -> None:
    """Raise UserError if a folder can't be written to, or has files that may not be replaced."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is a file. Name a folder.")
    if folder.is_dir():
        require_all_writable((folder / name for name in names), force=force)


def make_folder(folder: Path) -> None:
    """Make a folder and its parents if they don't exist; raise UserError if that fails."""
    try:
        create_folder(folder)
    except OSError as error:
        told = f"{folder}: cannot be made: {error.strerror}. Choose another place."
        raise UserError(told) from error


def create_folder(folder: Path) -> None:
    """Make a folder and its parents if they don't exist; raise OSError if that fails.

    Their names are on the disk then, so that a power cut doesn't take what will be in them.
    """
    new = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    sync_to_disk(*(one.parent for one in new))


def sync_to_disk(*paths: Path) -> None:
    """Wait until all that was written to files, or changed in folders, is on the disk.

    What can't be asked for that is named in the log, the first of several.
    """
    _warn_of_first([path for path in paths if not _is_synchronised(path)])


def sync_all(paths: Iterable[Path]) -> None:
    """Do as sync_to_disk() for many paths, some at once, which the disk does in one go."""
    from concurrent.futures import ThreadPoolExecutor

    left, unknown = iter(paths), list[Path]()
    with ThreadPoolExecutor(_SYNCS, "disk sync") as pool:
        while some := [*islice(left, 1 << 10)]:
            done = zip(some, pool.map(_is_synchronised, some), strict=True)
            unknown += [path for path, is_there in done if not is_there and not unknown]
    _warn_of_first(unknown)


def _warn_of_first(unknown: Sequence[Path]) -> None:
    """Name in the log the first path that can't be synchronised, if there is one."""
    if unknown:
        log.warning(
            "%s: its file system doesn't tell when data are on the disk: a power cut may take "
            "more than the last seconds",
            unknown[0] if unknown[0].is_dir() else unknown[0].parent,
        )


def _is_synchronised(path: Path) -> bool:
    """Synchronise a file or a folder; return false if it can't be asked for that."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except PermissionError:
        # One may be allowed to write into a folder, and not to read it.
        return False
    try:
        return sync_handle(handle)
    finally:
        os.close(handle)


def sync_handle(handle: int) -> bool:
    """Wait until what was written to a handle is on the disk; return false if nothing tells.

    The names in an open folder are what was written to it. Raises OSError if the disk lost some.
    """
    # fdatasync(2) needn't bring names to the disk, nor do all file systems.
    synchronise = os.fsync if stat.S_ISDIR(os.fstat(handle).st_mode) else os.fdatasync
    try:
        synchronise(handle)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise
        return False
    return True


def encode_image(path: Path, picture: NDArray[Any]) -> bytes:
    """Return a picture's bytes in the format that the path's ending names.

    The channels are in OpenCV's order, except that .npy keeps the array as it is. Raises UserError
    if the picture can't be encoded.
    """
    if path.suffix.lower() == ".npy":
        import numpy as np

        buffer = io.BytesIO()
        np.save(buffer, picture)
        return buffer.getvalue()
    import cv2

    done, data = cv2.imencode(path.suffix, picture)
    if not done:
        raise UserError(f"{path}: could not be encoded.")
    return data.tobytes()


@contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """Give a temporary name to write under; move the draft to its path when it is complete.

    It is on the disk then, and so is its name. Raises UserError if a run writes the file that would
    be replaced.
    """
    draft = name_draft(path)
    try:
        yield draft
        sync_to_disk(draft)
        move_into_place(draft, path, force=True)
        sync_to_disk(path.parent)
    except OSError as error:
        # Writes and syncs of open files tell no name, and that of the draft says nothing.
        error.filename = str(path)
        raise
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def write_atomically(path: Path, data: bytes) -> None:
    """Write bytes to a draft, which is moved to its path when it is complete."""
    with draft_of(path) as draft:
        draft.write_bytes(data)
