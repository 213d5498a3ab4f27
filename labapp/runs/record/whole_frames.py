"""Find the frames that are whole in a damaged record, and the settings that they were taken with.

A frame is whole if its image has the digest of its link. Its settings stand in the link, in the
columns, and in the copy of both, and count where they have their digest. Frames of format 2 are
whole if they have their checksum; where that is cut off, if all of their bytes are there.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import checksum
from labapp.runs.record import layout
from labapp.runs.record.chain import AT_ONCE, follow_frames, follows, merge_copies
from labapp.runs.record.digests import (
    SETTINGS,
    first_link,
    image_digest,
    pack_settings,
    packed_digest,
)
from labapp.runs.record.place_table import PlaceTable, TableError
from labapp.runs.record.repair import end_proof, frame_digests, repair_links
from labapp.runs.record.second_copy import read_both, tables_of_both
from optics.progress import Progress

_CHAIN, _STRUCTURE = (f"{layout.DIGESTS}/{name}" for name in ("chain", "structure"))

_STORED = f"{layout.DATA}/stored"

_Columns = dict[str, NDArray[Any]]


class WholeFrames:
    """Finds the frames of a damaged file that are whole.

    whole: which of the planned frames.
    known: of which of them the settings are, too.
    values: these settings as bytes.
    lacks: what else is lost, in words.
    """

    def __init__(self, handle: int, table: PlaceTable) -> None:
        self._handle, self._table = handle, table
        self._place = table.places[f"{layout.DATA}/images"]
        count = self._place.shape[0]
        self.whole, self.known = np.zeros(count, bool), np.zeros(count, bool)
        self.values = np.zeros((count, *layout.VALUES.shape), np.uint8)
        self.lacks: list[str] = []

    def image_bytes(self, index: int) -> bytes:
        """Return the bytes of a frame; fewer if the file ends before they do."""
        size = self._place.row_bytes
        return os.pread(self._handle, size, self._place.offset + index * size)

    def find_linked(self, progress: Progress) -> None:
        """Find the frames by their links, where there are digests."""
        columns = list(self._columns())
        try:
            structure = self._structure()
            found = follow_frames(self._links(structure), structure, len(self.whole))
            for rows in self._links(structure):
                self._note(rows, columns, progress)
        except (TableError, KeyError):
            self.lacks.append("the digests of the frames")
            return
        marks = read_both(self._handle, self._table, _STORED) if columns else []
        if found.broken is not None or any((one[~found.linked] != 0).any() for one in marks):
            self._note(self._repaired(structure, marks), columns, progress)

    def _links(self, structure: bytes) -> Iterator[NDArray[Any]]:
        """Return the rows of the chain, each from the copy in which it is whole."""
        blocks = [
            table.read_blocks(self._handle, _CHAIN, AT_ONCE)
            for table in tables_of_both(self._handle, self._table, _CHAIN)
        ]
        if not blocks:
            raise TableError("the chain is cut off")
        own, *copied = blocks
        return merge_copies(own, copied[0], structure) if copied else own

    def _structure(self) -> bytes:
        """Return the digest from which the chain begins; one of two, if they differ."""
        known = [one.tobytes() for one in read_both(self._handle, self._table, _STRUCTURE)]
        for structure in known:
            for rows in self._links(structure):
                if follows(rows[0], first_link(structure)):
                    return structure
                break
        return known[0]

    def _columns(self) -> Iterator[_Columns]:
        """Yield the measured columns, and their copy, as far as they are there."""
        both = [read_both(self._handle, self._table, f"{layout.DATA}/{n}") for n in SETTINGS]
        for number in range(min(map(len, both))):
            yield {name: one[number] for name, one in zip(SETTINGS, both, strict=True)}

    def _note(self, rows: NDArray[Any], columns: Iterable[_Columns], progress: Progress) -> None:
        """Note the whole frames of some links; of a frame's links, the last."""
        for row in rows[rows["image"].any(axis=1)]:
            frame, count = int(row["frame"]), len(self.whole)
            if frame >= count:
                continue
            progress.report(frame / count, f"look at frame {frame}")
            progress.raise_if_cancelled()
            image = np.frombuffer(self.image_bytes(frame), np.uint8)
            if image_digest(image) != row["image"].tobytes():
                continue
            self.whole[frame] = True
            known = _find_settings(row, columns)
            self.known[frame] |= known is not None
            if known is not None:
                self.values[frame] = np.frombuffer(known, np.uint8)

    def _repaired(self, structure: bytes, marks: list[NDArray[Any]]) -> NDArray[Any]:
        """Return the links with those that follow from frames and other links."""
        rows = np.concatenate(list(self._links(structure)))
        if marks:
            compute = frame_digests(self._handle, self._table)
            proof = end_proof(self._handle, self._table, structure)
            repair_links(rows, structure, marks[0], compute, proof)
        return rows

    def find_summed(self) -> None:
        """Find the frames of format 2 by their checksums."""
        columns = next(self._columns(), None)
        stored, sums = (
            next(iter(read_both(self._handle, self._table, f"{layout.DATA}/{name}")), None)
            for name in ("stored", "checksum")
        )
        if stored is None or sums is None:
            self.lacks.append("the checksums: nothing proves that the images are as taken")
        for index in range(len(self.whole)):
            data = self.image_bytes(index)
            whole = len(data) == self._place.row_bytes
            if stored is None or sums is None:
                # No exposure is black in every pixel; such a frame was never taken.
                self.whole[index] = whole and any(data)
            else:
                right = whole and checksum(np.frombuffer(data, np.uint8)) == sums[index]
                self.whole[index] = stored[index] and right
            if columns is not None:
                self.known[index] = True
                self.values[index] = np.frombuffer(_pack(columns, index), np.uint8)


def _find_settings(row: np.void, columns: Iterable[_Columns]) -> bytes | None:
    """Return the settings of a frame that have the digest in its link."""
    known, frame = row["settings"].tobytes(), int(row["frame"])
    inside = [row["values"].tobytes()] if "values" in (row.dtype.names or ()) else []
    told = chain(inside, (_pack(one, frame) for one in columns))
    return next((values for values in told if packed_digest(values) == known), None)


def _pack(columns: _Columns, frame: int) -> bytes:
    """Return the bytes of a frame's measured columns."""
    return b"".join(pack_settings({name: one[frame] for name, one in columns.items()}).values())
