"""A disk that a power cut may hit at any moment: what was written and not synchronised is drawn.

Written pages stay in memory until they are synchronised, or until the system likes. After a cut,
each unsynchronised page is lost, kept, or what it was at some moment between, in any order, and
torn at the borders of sectors; so are sizes of files. A name of a folder that wasn't synchronised
since may be there or not. A sync that fails loses pages for good, but memory shows them still
(P. Rebello et al., "Can Applications Recover from fsync Failures?", USENIX ATC 2020).
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from disks.trace import Event

PAGE, SECTOR = 4096, 512


@dataclass(repr=False)
class _File:
    """seen: what programs read. disk: what surely is on the disk. pending: what each page was
    after each write since, with the number of the write. doubtful: the same of failed syncs."""

    seen: bytearray = field(default_factory=bytearray)
    disk: bytearray = field(default_factory=bytearray)
    pending: dict[int, list[tuple[int, bytes]]] = field(default_factory=dict)
    doubtful: dict[int, list[bytes]] = field(default_factory=dict)
    sizes: list[tuple[int, int]] = field(default_factory=list)

    def write(self, number: int, place: int, data: bytes) -> None:
        place = len(self.seen) if place < 0 else place
        end = place + len(data)
        if end > len(self.seen):
            self.resize(number, end)
        self.seen[place:end] = data
        for page in range(place // PAGE, -(-end // PAGE)):
            self._note(number, page)

    def resize(self, number: int, size: int) -> None:
        cut = size < len(self.seen)
        self.seen = self.seen[:size].ljust(size, b"\0")
        self.sizes.append((number, size))
        for page in [page for page in self.pending if cut and page * PAGE >= size]:
            del self.pending[page]
        if cut and size % PAGE:
            self._note(number, size // PAGE)

    def _note(self, number: int, page: int) -> None:
        whole = bytes(self.seen[page * PAGE : (page + 1) * PAGE].ljust(PAGE, b"\0"))
        self.pending.setdefault(page, []).append((number, whole))

    def keep(self, until: int) -> None:
        """A sync that began after the write of a number has succeeded."""
        for kept, size in self.sizes:
            if kept <= until:
                self.disk = self.disk[:size].ljust(size, b"\0")
        self.sizes = [one for one in self.sizes if one[0] > until]
        for page, versions in [*self.pending.items()]:
            if done := [data for number, data in versions if number <= until]:
                self._put(self.disk, page, done[-1])
                self.doubtful.pop(page, None)
                self.pending[page] = [one for one in versions if one[0] > until]
                if not self.pending[page]:
                    del self.pending[page]

    def lose(self, until: int) -> None:
        """A sync failed: the pages count as written, and may be anything that they were."""
        for page, versions in [*self.pending.items()]:
            if done := [data for number, data in versions if number <= until]:
                self.doubtful.setdefault(page, []).extend(done)
                self.pending[page] = [one for one in versions if one[0] > until]
                if not self.pending[page]:
                    del self.pending[page]

    @property
    def is_on_disk(self) -> bool:
        return not (self.pending or self.doubtful or self.sizes)

    def draw(self, rng: np.random.Generator, fate: _Fate) -> bytes:
        """What the disk holds after a power cut."""
        found, sizes = bytearray(self.disk), [len(self.disk), *(size for _, size in self.sizes)]
        size = sizes[-1 if fate.written else fate.choose(rng, len(sizes))]
        found = found[:size].ljust(size, b"\0")
        for page in {*self.doubtful, *self.pending}:
            old = bytes(self.disk[page * PAGE : (page + 1) * PAGE].ljust(PAGE, b"\0"))
            versions = [old, *self.doubtful.get(page, ())]
            versions += [data for _, data in self.pending.get(page, ())]
            if fate.written:
                # What a failed sync lost is as it was, or not, unless it was written once more.
                some = versions[: 1 + len(self.doubtful.get(page, ()))]
                versions = versions[-1:] if page in self.pending else some
            self._put(found, page, fate.draw_page(rng, versions))
        return bytes(found)

    @staticmethod
    def _put(whole: bytearray, page: int, data: bytes) -> None:
        """What is written beyond the end of a file isn't part of it."""
        end = min((page + 1) * PAGE, len(whole))
        if end > page * PAGE:
            whole[page * PAGE : end] = data[: end - page * PAGE]


@dataclass(frozen=True)
class _Fate:
    """How likely what wasn't synchronised is kept; bytes that are kept or lost together.

    torn: share of those that are torn. written: whether the system has had time to write all.
    """

    keep: float
    unit: int
    torn: float
    written: bool = False

    @staticmethod
    def draw(rng: np.random.Generator, *, written: bool) -> _Fate:
        if written:
            return _Fate(0.5 * rng.random(), PAGE, 0.0, written=True)
        keep = float(rng.choice([0.0, 1.0, 0.97, rng.random(), rng.random()]))
        return _Fate(keep, int(rng.choice([512, 1024, 2048, 4096])), float(rng.random() * 0.5))

    def choose(self, rng: np.random.Generator, count: int) -> int:
        """The place of what is kept among so many versions, the newest last."""
        return count - 1 if count < 2 or rng.random() < self.keep else int(rng.integers(count - 1))

    def draw_page(self, rng: np.random.Generator, versions: list[bytes]) -> bytes:
        parts = []
        for begin in range(0, PAGE, self.unit):
            unit = SECTOR if rng.random() < self.torn else self.unit
            for place in range(begin, begin + self.unit, unit):
                parts.append(versions[self.choose(rng, len(versions))][place : place + unit])
        return b"".join(parts)


@dataclass(eq=False)
class _Change:
    """Names that changed: gone, then come, with the file. folder: that must be synchronised."""

    gone: str
    come: str
    what: _File | None
    folder: str


class Disk:
    """The files of a folder, by what was written to them and what was synchronised."""

    def __init__(self, folder: Path, before: Mapping[str, bytes | None]) -> None:
        """before: what `snapshot` found, as if it had been there for long."""
        self._folder = str(folder)
        self._names = {
            path: None if data is None else _File(bytearray(data), bytearray(data))
            for path, data in before.items()
        }
        self._sure = dict(self._names)
        self._gone: dict[str, _File | None] = {}
        self._changes: list[_Change] = []
        self._begun: dict[int, tuple[int, int]] = {}
        self._writes = 0

    def apply(self, event: Event) -> None:
        getattr(self, f"_{event.kind}")(event)

    def apply_all(self, events: Iterable[Event]) -> None:
        for event in events:
            self.apply(event)

    def file(self, path: str | Path) -> _File:
        path = str(path)
        found = self._names[path] if path in self._names else self._gone[path]
        assert found is not None, path
        return found

    def names_on_disk(self) -> bool:
        """Whether all changes of names are on the disk."""
        return not self._changes

    def draw(self, rng: np.random.Generator, *, written: bool = False) -> dict[str, bytes]:
        """What the folder holds after a power cut now: the content of its files, by path.

        written: whether the cut comes when the system has written all that it had in memory.
        """
        fate, names = _Fate.draw(rng, written=written), dict(self._sure)
        if written:
            names = dict(self._names)
        in_order = rng.random() < 0.5
        last = fate.choose(rng, len(self._changes) + 1)
        for number, change in enumerate(() if written else self._changes):
            if number < last if in_order else rng.random() < fate.keep:
                _rename(names, change)
        drawn = {id(file): file.draw(rng, fate) for file in names.values() if file is not None}
        return {
            path: drawn[id(file)]
            for path, file in names.items()
            if file is not None and self._is_reached(names, path)
        }

    def _is_reached(self, names: Mapping[str, _File | None], path: str) -> bool:
        while (path := os.path.dirname(path)) != self._folder:
            if path not in names:
                return False
        return True

    def _told(self, event: Event) -> None:
        pass

    def _open(self, event: Event) -> None:
        if event.path not in self._names:
            self._change("", event.path, _File())
        elif event.size:
            self._size(event)

    def _write(self, event: Event) -> None:
        self._writes += 1
        self.file(event.path).write(self._writes, event.size, event.data)

    def _size(self, event: Event) -> None:
        self._writes += 1
        size = 0 if event.kind == "open" else event.size
        self.file(event.path).resize(self._writes, size)

    def _begin(self, event: Event) -> None:
        self._begun[event.number] = self._writes, len(self._changes)

    def _end(self, event: Event) -> None:
        writes, changes = self._begun.pop(event.number)
        if event.path in self._names and self._names[event.path] is None:
            if event.size and event.other == "fsync":
                self._keep_names(event.path, changes)
        elif event.size:
            self.file(event.path).keep(writes)
        else:
            self.file(event.path).lose(writes)

    def _keep_names(self, folder: str, count: int) -> None:
        for change in [one for one in self._changes[:count] if one.folder == folder]:
            _rename(self._sure, change)
            self._changes.remove(change)

    def _link(self, event: Event) -> None:
        self._change("", event.other, self._names[event.path])

    def _rename(self, event: Event) -> None:
        self._change(event.path, event.other, self._names[event.path])

    def _unlink(self, event: Event) -> None:
        self._change(event.path, "", None)

    _rmdir = _unlink

    def _mkdir(self, event: Event) -> None:
        self._change("", event.path, None)

    def _change(self, gone: str, come: str, what: _File | None) -> None:
        # A file that moves is at its new name when the folder of that was synchronised.
        change = _Change(gone, come, what, os.path.dirname(come or gone))
        if gone:
            self._gone[gone] = self._names[gone]
        _rename(self._names, change)
        self._changes.append(change)


def _rename(names: dict[str, _File | None], change: _Change) -> None:
    if change.gone:
        names.pop(change.gone, None)
    if change.come:
        names[change.come] = change.what


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """A folder, the folders in it (None) and its files, by path."""
    there = (folder, *sorted(folder.rglob("*")))
    return {str(path): path.read_bytes() if path.is_file() else None for path in there}


def put(files: Mapping[str, bytes], before: Path, folder: Path) -> None:
    """Write what a disk holds into another folder than it was drawn for."""
    for path, data in files.items():
        there = folder / Path(path).relative_to(before)
        there.parent.mkdir(parents=True, exist_ok=True)
        there.write_bytes(data)
