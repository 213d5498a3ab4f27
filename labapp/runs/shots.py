"""The shots of a run: one planned frame, and a list of a million in some 50 bytes each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from labapp.files.plan_file import ROLES, Role
from labapp.runs.readouts import AS_OPENED, Readout

_AT_ONCE = 1024
"""Shots that are made at once while a list is gone through. Chosen: little memory, little loss."""


@dataclass(frozen=True)
class Shot:
    """One planned frame, with all of its settings.

    index: number of the frame in the record.
    step, repeat: step of the plan, and number of the frame within the step.
    target, pattern: names in the plan.
    wavelength: metres.
    exposure: seconds.
    role: "light", or the kind of calibration frame.
    place: name of the target on the bench; "" leaves the one that is there.
    prompt: what a person is asked to do before the target is placed.
    slot: slot of a filter wheel, from 1; 0 means that the wavelength is set.
    readout: how the sensor is read, and how many frames are averaged.
    start_time: planned beginning of the exposure, seconds from the beginning of the run.
    duration: what the frame takes, settling included, seconds.
    """

    index: int
    step: int
    repeat: int
    target: str
    pattern: str
    wavelength: float
    exposure: float
    role: Role = "light"
    place: str = ""
    prompt: str = ""
    slot: int = 0
    readout: Readout = AS_OPENED
    start_time: float = 0.0
    duration: float = 0.0


class ShotTarget(NamedTuple):
    """A target's name in the plan, its place on the bench, and its prompt."""

    name: str
    place: str = ""
    prompt: str = ""


_KINDS: dict[str, np.dtype[Any]] = {
    "index": np.dtype("i4"),
    "step": np.dtype("u4"),
    "repeat": np.dtype("u4"),
    "target": np.dtype("u2"),
    "pattern": np.dtype("u2"),
    "wavelength": np.dtype("f8"),
    "exposure": np.dtype("f8"),
    "role": np.dtype("u1"),
    "slot": np.dtype("u2"),
    "readout": np.dtype("u2"),
    "start_time": np.dtype("f8"),
    "duration": np.dtype("f8"),
}
"""Columns of a list of shots; target, pattern, role and readout are indices."""


class ShotList(Sequence[Shot]):
    """Shots as columns, each made when it is asked for; it is never changed.

    columns: arrays of the same length by name of a Shot's attribute, those of zeros left out.
        `target`, `pattern` and `readout` are indices into `targets`, `patterns` and `readouts`,
        `role` into ROLES.
    """

    def __init__(
        self,
        columns: Mapping[str, NDArray[Any]],
        targets: Sequence[ShotTarget],
        patterns: Sequence[str],
        readouts: Sequence[Readout] = (AS_OPENED,),
    ) -> None:
        self.targets, self.patterns = tuple(targets), tuple(patterns)
        self.readouts = tuple(readouts)
        self._length = len(columns["target"])
        self._columns = {
            name: np.asarray(columns.get(name, np.zeros(self._length, kind)), kind)
            for name, kind in _KINDS.items()
        }

    @classmethod
    def of(cls, shots: Iterable[Shot]) -> ShotList:
        """Return shots as such a list; one that is such a list already stays itself."""
        if isinstance(shots, ShotList):
            return shots
        targets: dict[ShotTarget, int] = {}
        patterns: dict[str, int] = {}
        readouts: dict[Readout, int] = {}
        rows = [
            (
                one.index, one.step, one.repeat,
                targets.setdefault(ShotTarget(one.target, one.place, one.prompt), len(targets)),
                patterns.setdefault(one.pattern, len(patterns)),
                one.wavelength, one.exposure, ROLES.index(one.role), one.slot,
                readouts.setdefault(one.readout, len(readouts)), one.start_time, one.duration,
            )
            for one in shots
        ]  # fmt: skip
        table = np.array(rows, list(_KINDS.items()))
        columns = {name: table[name] for name in _KINDS}
        return cls(columns, list(targets), list(patterns), list(readouts))

    def column(self, name: str) -> NDArray[Any]:
        """Return an attribute of all shots; don't change it."""
        return self._columns[name]

    def with_columns(self, **columns: NDArray[Any]) -> ShotList:
        """Return the shots with other values of some attributes."""
        columns = {**self._columns, **columns}
        return ShotList(columns, self.targets, self.patterns, self.readouts)

    def pick(self, which: slice | Sequence[int] | NDArray[np.intp]) -> ShotList:
        """Return the shots of a slice, or of indices."""
        which = which if isinstance(which, slice) else np.asarray(which, np.intp)
        columns = {name: column[which] for name, column in self._columns.items()}
        return ShotList(columns, self.targets, self.patterns, self.readouts)

    def distinct(self, *names: str) -> ShotList:
        """Return the first of all shots that are alike in some attributes, in order."""
        return self._first_of_each(*(self._columns[name] for name in names))

    def distinct_pictures(self) -> ShotList:
        """Return the first of all shots whose sensor sees the same light and gain.

        Regions and binned pixels are read of the same picture.
        """
        gains = np.array([one.amplification_db for one in self.readouts])[self._columns["readout"]]
        names = ("target", "pattern", "wavelength", "exposure")
        return self._first_of_each(*(self._columns[name] for name in names), gains)

    def _first_of_each(self, *columns: NDArray[Any]) -> ShotList:
        """Return the first of all shots that are alike in some columns, in order."""
        codes = group_codes(*columns)
        return self.pick(np.sort(np.unique(codes, return_index=True)[1]))

    @property
    def total_duration(self) -> float:
        """Seconds that all shots take together."""
        return math.fsum(self._columns["duration"])

    def __len__(self) -> int:
        return self._length

    @overload
    def __getitem__(self, which: int) -> Shot: ...

    @overload
    def __getitem__(self, which: slice) -> ShotList: ...

    def __getitem__(self, which: int | slice) -> Shot | ShotList:
        if isinstance(which, slice):
            return self.pick(which)
        number = range(self._length)[which]
        return next(iter(self.pick(slice(number, number + 1))))

    def __iter__(self) -> Iterator[Shot]:
        for first in range(0, self._length, _AT_ONCE):
            part = (c[first : first + _AT_ONCE].tolist() for c in self._columns.values())
            for index, step, repeat, target, pattern, *rest in zip(*part, strict=True):
                wavelength, exposure, role, slot, readout, start_time, duration = rest
                name, place, prompt = self.targets[target]
                yield Shot(
                    index, step, repeat, name, self.patterns[pattern], wavelength, exposure,
                    ROLES[role], place, prompt, slot, self.readouts[readout], start_time, duration,
                )  # fmt: skip

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return len(self) == len(other) and all(a == b for a, b in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]


def group_codes(*columns: NDArray[Any]) -> NDArray[np.int64]:
    """Number the rows of some columns, with the same number for equal rows.

    The numbers are below that of the rows.
    """
    codes = np.zeros(len(columns[0]), np.int64)
    for column in columns:
        values, inverse = np.unique(column, return_inverse=True)
        codes = np.unique(codes * len(values) + inverse, return_inverse=True)[1]
    return codes
