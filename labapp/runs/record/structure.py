"""The structure of a record: whether it is as it was made, and refers to no other file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import h5py

from labapp.common.errors import UserError
from labapp.files.guarded_reading import FREE_EXPANSION
from labapp.files.plain_hdf5 import (
    explain_system_error,
    has_variable_length,
    memory_size,
    walk_datasets,
)
from labapp.runs.record import layout
from labapp.runs.record.digests import structure_digest
from labapp.runs.record.place_table import PlaceTable, TableError, read_table
from labapp.runs.record.second_copy import BETWEEN
from labapp.runs.record.verification import advise_salvage

_LARGEST = 1 << 29
"""Bytes that a dataset without pictures may have: a column of two million frames takes 16 MB.
Chosen."""

_READ_IN_PARTS = (*layout.LARGE, f"{layout.DIGESTS}/chain")
"""Datasets that may be larger, since they are never in memory as a whole."""


_SHORT_TEXTS = frozenset(
    f"entry/{name}" for name in ("title", "definition", "start_time", "clock", "writer")
)
"""Texts that are shown, and have a line."""

_LONGEST_TEXT = 1 << 16
"""Bytes of such a text. Chosen."""


@dataclass(frozen=True)
class Structure:
    """How a file is built, and whether that has changed.

    table: where its datasets lie.
    changed: whether the structure isn't the one that its digest tells.
    lost: names of datasets that have changed, or are cut off.
    """

    table: PlaceTable
    changed: bool
    lost: tuple[str, ...]

    def explain(self, path: Path) -> str:
        """Return what has changed, and the remedy."""
        parts = ", ".join(self.lost) or BETWEEN
        return f"{parts} changed since the run began. {advise_salvage(path)}"


def read_structure(path: Path) -> Structure | None:
    """Read the structure without HDF5; None if there is no table of places."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        table = read_table(handle)
        digest = table.read(handle, f"{layout.DIGESTS}/structure").tobytes()
        changed = structure_digest(handle, table) != digest
        # Patterns are large; whoever uses them compares them with their own digests.
        fixed = (n for n in table.places if n not in (*layout.CHANGING, layout.SHOWN_IMAGES))
        lost = tuple(n for n in fixed if not table.is_whole(handle, n)) if changed else ()
        return Structure(table, changed, lost)
    except (TableError, KeyError):
        return None
    finally:
        os.close(handle)


def require_plain_structure(file: h5py.File, path: Path) -> None:
    """Raise UserError unless all data of an open HDF5 file lie in the file itself, in one piece.

    Other links than hard ones, external storage, virtual and chunked datasets are refused before
    anything is read, since reading them opens other files, or takes memory without end.
    """
    try:
        _require_plain(file, path)
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        if (told := explain_system_error(error)) is not None:
            raise UserError(f"{path}: {told}") from error
        raise UserError(
            f"{path}: is damaged: HDF5 doesn't find its way in it ({error}). {advise_salvage(path)}"
        ) from error


def _require_plain(file: h5py.File, path: Path) -> None:
    """Raise UserError for data elsewhere than in the file, and h5py's errors."""
    size = path.stat().st_size
    for name, dataset in walk_datasets(file, path):
        storage = dataset.id.get_create_plist()
        place = dataset.id.get_offset()
        nbytes = dataset.id.get_storage_size()
        plain = storage.get_layout() == h5py.h5d.CONTIGUOUS and not storage.get_external_count()
        # What isn't stored is made up from a fill value, in any amount. A text of variable length
        # may have that of the file.
        is_text = has_variable_length(dataset) and dataset.size == 1 and size <= FREE_EXPANSION
        plain = plain and (is_text or nbytes == memory_size(dataset))
        if not plain or (nbytes and (place is None or place + nbytes > size)):
            raise UserError(
                f"{path}: {name} doesn't lie within the file in one piece, as labapp writes it. "
                "Don't trust the file; get the original."
            )
        most = _LONGEST_TEXT if name in _SHORT_TEXTS else _LARGEST
        if nbytes > most and name not in _READ_IN_PARTS:
            raise UserError(
                f"{path}: {name} has {nbytes / 1e6:.0f} MB, more than any run writes. Don't trust "
                "the file; get the original."
            )
