"""The structure of a record: whether it is as it was made, and refers to no other file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from labapp.common.errors import UserError
from labapp.runs.record import layout
from labapp.runs.record.digests import structure_digest
from labapp.runs.record.place_table import PlaceTable, TableError, read_table

_MOST_OBJECTS = 1000
"""Groups and datasets that a record may have, about ten times more than any has. Chosen."""

_LARGEST = 1 << 28
"""Bytes that a dataset without pictures may have: the digests of a million frames take a little
less. Chosen."""


@dataclass(frozen=True)
class Structure:
    """The structure of a record's file.

    table: where its datasets lie. digest: in the file, as bytes. changed: whether the structure
    isn't the one that the digest tells. lost: names of datasets that have changed, or are cut off.
    """

    table: PlaceTable
    digest: bytes
    changed: bool
    lost: tuple[str, ...]

    def explain(self) -> str:
        """Return what has changed in the structure of a run's record, and the remedy."""
        parts = ", ".join(self.lost) or "bytes between its datasets"
        return (
            f"{parts} changed since the run began. Restore the file from a copy, or save the "
            "frames with: labapp salvage"
        )


def read_structure(path: Path) -> Structure | None:
    """Read the structure of a run's record without HDF5; None if it has no table of places."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        table = read_table(handle)
        digest = table.read(handle, f"{layout.DIGESTS}/structure").tobytes()
        changed = structure_digest(handle, table) != digest
        # Patterns are large; whoever uses them compares them with their own digests.
        fixed = (n for n in table.places if n not in (*layout.CHANGING, layout.SHOWN_IMAGES))
        lost = tuple(n for n in fixed if not table.is_whole(handle, n)) if changed else ()
        return Structure(table, digest, changed, lost)
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
        raise UserError(
            f"{path}: is damaged: HDF5 doesn't find its way in it ({error}). Restore it from a "
            "copy, or save its frames with: labapp salvage"
        ) from error


def _require_plain(file: h5py.File, path: Path) -> None:
    """Raise UserError for data elsewhere than in the record's file, and h5py's errors."""
    size = path.stat().st_size
    for name, dataset in _datasets(file, path):
        storage = dataset.id.get_create_plist()
        place = dataset.id.get_offset()
        nbytes = dataset.id.get_storage_size()
        plain = storage.get_layout() == h5py.h5d.CONTIGUOUS and not storage.get_external_count()
        if not plain or (nbytes and (place is None or place + nbytes > size)):
            raise UserError(
                f"{path}: {name} doesn't lie within the file in one piece, as labapp writes it. "
                "Don't trust the file; get the original."
            )
        if nbytes > _LARGEST and name not in (layout.SHOWN_IMAGES, f"{layout.DATA}/images"):
            raise UserError(
                f"{path}: {name} has {nbytes / 1e6:.0f} MB, more than any run writes. Don't trust "
                "the file; get the original."
            )


def _datasets(file: h5py.File, path: Path) -> Iterator[tuple[str, Any]]:
    """Yield name and dataset of all that an HDF5 file links; raise UserError for other links."""
    seen, groups = 0, [("", file["/"])]
    while groups:
        prefix, group = groups.pop()
        for link in group.id:
            seen += 1
            name = prefix + link.decode(errors="replace")
            kind = group.id.links.get_info(link).type
            if kind != h5py.h5l.TYPE_HARD or seen > _MOST_OBJECTS:
                what = "is a link to elsewhere" if seen <= _MOST_OBJECTS else "is one too many"
                raise UserError(
                    f"{path}: {name} {what}: no run writes that. Don't trust the file; get the "
                    "original."
                )
            item = group[link]
            if isinstance(item, h5py.Group):
                groups.append((f"{name}/", item))
            elif isinstance(item, h5py.Dataset):
                yield name, item
