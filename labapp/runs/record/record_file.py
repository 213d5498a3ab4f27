"""The file of a record, also while it is being written, and after its writer was killed."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import checksum
from labapp.common.errors import UserError
from labapp.files.file_lookup import require_file
from labapp.files.guarded_reading import FREE_EXPANSION, unreadable
from labapp.files.plain_hdf5 import (
    explain_system_error,
    has_variable_length,
    memory_size,
    open_hdf5,
    walk_datasets,
)
from labapp.runs.record import digests, layout
from labapp.runs.record.chain import AT_ONCE, FrameChain, LogChain, follow_frames, follow_log
from labapp.runs.record.digests import structure_digest
from labapp.runs.record.place_table import PlaceTable, TableError, find_places, read_table
from labapp.runs.record.second_copy import BETWEEN, read_either_table
from labapp.runs.record.verification import advise_salvage
from labapp.runs.state import State
from optics.progress import Progress

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


_SIGNATURE = b"\x89HDF\r\n\x1a\n"

_LINKS_AT_ONCE, _LINK_BLOCKS = 1 << 10, 16
"""Links of frames that are read at once, and how often that many are kept: 1.6 MB, for records of
up to 16 sittings. Chosen."""

_DAMAGE_ERRORS = (
    KeyError,
    OSError,
    RuntimeError,
    ValueError,
    TypeError,
    AttributeError,
    MemoryError,
)
"""Exceptions of h5py, and of decoding, when a file is damaged."""


class RecordFile:
    """The file of a record, opened for reading: its datasets, and the digests that protect them.

    damaged: whether one is opened whose structure has changed since it was made. Every property
        and method raises UserError if the file is damaged.
    """

    def __init__(self, path: Path, *, damaged: bool = False) -> None:
        self.path = path
        require_file(path)
        try:
            self.structure = read_structure(path)
        except OSError as error:
            raise unreadable(path, error) from error
        if self.structure is not None and path.stat().st_size < self.structure.table.size:
            there, full = path.stat().st_size, self.structure.table.size
            raise UserError(f"{path}: {_cut_short(path, there, full)}")
        if self.structure is not None and self.structure.changed and not damaged:
            raise UserError(f"{path}: is damaged: {self.structure.explain(path)}")
        try:
            self._file = open_hdf5(path)
        except (OSError, RuntimeError) as error:
            raise UserError(f"{path}: {_explain_open_failure(path, error)}") from error
        self._found: dict[str, h5py.Dataset] = {}
        self._links: dict[int, NDArray[Any]] = {}
        try:
            with self._damage_as_user_error("labapp_format"):
                self.format = self._file.attrs.get("labapp_format")
            if self.format not in (*layout.PROTECTED_FORMATS, layout.UNPROTECTED_FORMAT):
                raise UserError(
                    f"{path}: is not a record of format {layout.FORMAT} (found {self.format}). "
                    "Give a record that `labapp run` or `labapp demo` wrote."
                )
            require_plain_structure(self._file, path)
        except UserError:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._found.clear()
        self._file.close()

    @property
    def is_protected(self) -> bool:
        """Whether there are digests; older formats have none."""
        return bool(self.format != layout.UNPROTECTED_FORMAT)

    @property
    def frame_count(self) -> int:
        with self._damage_as_user_error(f"{layout.DATA}/images"):
            return int(self._file[f"{layout.DATA}/images"].shape[0])

    def column(self, name: str) -> NDArray[Any]:
        """Return a column, one value per planned frame.

        labapp.runs.record.layout lists the columns.
        """
        if name == "readout" and not self._has(layout.READOUTS):
            return np.zeros(self.frame_count, layout.PLANNED[name])
        return self._read(f"{layout.DATA}/{name}")

    @property
    def log(self) -> list[tuple[float, str]]:
        return list(self.log_lines())

    def log_lines(self) -> Iterator[tuple[float, str]]:
        """Yield bench time in seconds and text of the lines in the log, one by one."""
        for rows in self._blocks("entry/log"):
            with self._damage_as_user_error("entry/log"):
                lines = [(float(r["time"]), r["text"]) for r in rows[rows["text"] != b""]]
            yield from ((time, text.decode(errors="replace")) for time, text in lines)

    def frames_not_stored(self) -> list[int]:
        """Return the indices of planned frames that were never stored."""
        return np.flatnonzero(self.column("stored") == 0).tolist()

    def missing_frames(self) -> list[int]:
        """Return the indices of frames that were never stored, or are damaged since."""
        stored = np.flatnonzero(self.column("stored"))
        return sorted(self.frames_not_stored() + self.damaged_frames(stored, Progress()))

    def read_back(
        self, indices: Sequence[int], progress: Progress
    ) -> tuple[list[int], list[int], list[int]]:
        """Read frames back; return the indices of intact, never stored and damaged ones."""
        wanted, stored = np.array(indices, np.intp), self.column("stored") != 0
        damaged = self.damaged_frames(wanted[stored[wanted]], progress)
        whole = stored.copy()
        whole[damaged] = False
        return wanted[whole[wanted]].tolist(), wanted[~stored[wanted]].tolist(), damaged

    def damaged_frames(self, indices: NDArray[np.intp], progress: Progress) -> list[int]:
        """Return those of some stored frames that don't read back."""
        is_whole, damaged = self._frame_check(), []
        # One by one: a list of all of them would take most of the memory of the check.
        for done, index in enumerate(map(int, indices)):
            progress.report(done / len(indices), f"read frame {index} back")
            if not is_whole(index):
                damaged.append(index)
        return damaged

    def _frame_check(self) -> Callable[[int], bool]:
        """Return the function that tells whether a stored frame is whole.

        By its link, which covers image and settings; in older formats by its checksum.
        """
        if not self.is_protected:
            sums = self.column("checksum")
            return lambda index: self._image_has(
                index, lambda image: checksum(image) == sums[index]
            )
        latest, rows = self.frame_chain.latest, self._link
        columns = {name: self.column(name) for name in digests.SETTINGS}

        def is_whole(index: int) -> bool:
            if latest[index] < 0:
                return False
            row = rows(int(latest[index]))
            settings = digests.pack_settings({n: column[index] for n, column in columns.items()})
            found = digests.packed_digest(b"".join(settings.values()))
            return bool(found == row["settings"].tobytes()) and self._image_has(
                index, lambda image: digests.image_digest(image) == row["image"].tobytes()
            )

        return is_whole

    def _link(self, number: int) -> np.void:
        """Return a row of the frames' chain; rows nearby are read along with it."""
        first = number - number % _LINKS_AT_ONCE
        if first not in self._links:
            if len(self._links) == _LINK_BLOCKS:
                del self._links[next(iter(self._links))]
            name = f"{layout.DIGESTS}/chain"
            self._links[first] = self._read(name, slice(first, first + _LINKS_AT_ONCE))
        found: np.void = self._links[first][number - first]
        return found

    def _image_has(self, index: int, test: Callable[[NDArray[np.uint16]], bool]) -> bool:
        """Return whether a frame's image can be read and passes a test."""
        try:
            return test(self._read(f"{layout.DATA}/images", index))
        except UserError:
            return False

    @cached_property
    def frame_chain(self) -> FrameChain:
        """The links of the frames, as they were when they were first asked for."""
        name = f"{layout.DIGESTS}/chain"
        with self._damage_as_user_error(name):
            return follow_frames(self._blocks(name), self._structure_digest, self.frame_count)

    @property
    def log_chain(self) -> LogChain:
        with self._damage_as_user_error("entry/log"):
            return follow_log(self._blocks("entry/log"), self._structure_digest)

    @property
    def lost_log_lines(self) -> int:
        """Lines for which the log had no room."""
        return int(self._read("entry/log_lost")[0]) if self.is_protected else 0

    @property
    def _structure_digest(self) -> bytes:
        return bytes(self._read(f"{layout.DIGESTS}/structure")[0])

    def compute_closing_digest(self, state: State | None = None) -> str:
        """Compute the digest over all, in hexadecimal: as it is, or with another state."""
        frames, lines = self.frame_chain, self.log_chain
        ending = {name: self._read(f"entry/{name}").tobytes() for name in digests.ENDING}
        if state is not None:
            ending["state"] = np.array(state.value.encode(), layout.STATE).tobytes()
        return digests.closing_digest(
            self._structure_digest, frames.length, frames.last, lines.length, lines.last,
            ending.values(),
        ).hex()  # fmt: skip

    def moved_datasets(self) -> list[str]:
        """Return the datasets that lie elsewhere than the table of places tells."""
        if self.structure is None:
            return []
        known = self.structure.table
        there = find_places(self._file, known.size)
        return [
            name
            for name in sorted({*known.places, *there.places})
            if name not in known.places
            or replace(known.places[name], digest="") != there.places.get(name)
        ]

    def _has(self, name: str) -> bool:
        """Return whether there is a dataset, which older records may lack."""
        with self._damage_as_user_error(name):
            return name in self._file

    def _read(self, name: str, rows: Any = ()) -> Any:
        """Read a dataset by its path, or some of its rows."""
        with self._damage_as_user_error(name):
            # Finding a dataset takes HDF5 longer than reading a small frame.
            if name not in self._found:
                self._found[name] = self._file[name]
            return self._found[name][rows]

    def _blocks(self, name: str) -> Iterator[NDArray[Any]]:
        """Yield the rows of a dataset, some thousands at once."""
        with self._damage_as_user_error(name):
            count = len(self._file[name])
        for first in range(0, count, AT_ONCE):
            yield self._read(name, slice(first, first + AT_ONCE))

    def text(self, name: str) -> str:
        """Return a text of the entry, such as title or start_time, by name."""
        with self._damage_as_user_error(f"entry/{name}"):
            return self._read(f"entry/{name}").decode()

    def _single_text(self, name: str) -> str:
        """Read a text that is a dataset with a single row in the entry."""
        with self._damage_as_user_error(f"entry/{name}"):
            return self._read(f"entry/{name}")[0].decode()

    def _texts(self, name: str) -> list[str]:
        with self._damage_as_user_error(name):
            return [text.decode() for text in self._read(name)]

    def _json(self, name: str) -> Any:
        with self._damage_as_user_error(f"entry/{name}"):
            return json.loads(self.text(name))

    @contextmanager
    def _damage_as_user_error(self, name: str) -> Iterator[None]:
        """Raise UserError that names a damaged part if the block can't read it."""
        try:
            yield
        except _DAMAGE_ERRORS as error:
            if (told := explain_system_error(error)) is not None:
                raise UserError(f"{self.path}: {name} {told}") from error
            raise UserError(
                f"{self.path}: is damaged: {name} is missing or can't be read. "
                f"{advise_salvage(self.path)}"
            ) from error


def _explain_open_failure(path: Path, error: Exception) -> str:
    """Return why HDF5 doesn't open a file, and what the user should do."""
    if (told := explain_system_error(error)) is not None:
        return told
    if not _is_record(path):
        return "is not an HDF5 file, or has lost its beginning. Give a record of a run."
    if (full := stored_file_size(error)) is not None:
        return _cut_short(path, path.stat().st_size, full)
    return f"is damaged: HDF5 can't open it ({error}). {advise_salvage(path)}"


def _is_record(path: Path) -> bool:
    """Return whether a file that HDF5 can't open may be a record all the same."""
    with path.open("rb") as file:
        try:
            read_either_table(file.fileno())
        except TableError:
            return file.read(len(_SIGNATURE)) == _SIGNATURE
        return True


def stored_file_size(error: Exception) -> int | None:
    """Return the size that a truncated file had by HDF5's error; None for other errors."""
    found = re.search(r"truncated file: eof = \d+,.*stored_eof = (\d+)", str(error))
    return int(found[1]) if found else None


def _cut_short(path: Path, there: int, full: int) -> str:
    return f"is cut short: {there} of {full} bytes are there. {advise_salvage(path)}"
