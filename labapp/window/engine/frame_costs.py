"""What frames cost beyond their time on the bench's clock, as measured in this run and before."""

from __future__ import annotations

import json
import logging
import os
import statistics
import sys
from collections.abc import Sequence, Set
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.guarded_reading import open_regular
from labapp.files.plain_data import parse_json
from labapp.files.writing import write_atomically
from labapp.runs.shots import Shot

log = logging.getLogger(__name__)

PREPARING = "preparing"
"""Name of the cost of what comes before the first frame, for each setting that is new."""

PREPARING_KNOWN = "preparing known"
"""The same for each setting that was taken before in this session."""

Setting = tuple[str, str, float, float]
"""What decides on a picture: place of the target, pattern, wavelength and exposure."""

_KEPT = 5
"""Runs over which a cost is a median. Chosen: it follows a change of the bench in three runs."""

_MOST_BYTES = 1 << 20
"""Bytes that the file may have. Chosen."""


def setting_of(shot: Shot) -> Setting:
    return (shot.place or shot.target, shot.pattern, shot.wavelength, shot.exposure)


def frame_kinds(shots: Sequence[Shot], known: Set[Setting] = frozenset()) -> list[str]:
    """Return the kind of each frame, of which all cost about the same.

    A frame is of another kind on each target, and where its setting is new: a simulated picture is
    computed once for a setting, and further frames differ by their noise alone. Settings of earlier
    runs are `known`: their pictures may be kept.
    """
    seen: set[Setting] = set()
    kinds: list[str] = []
    for shot in shots:
        setting = setting_of(shot)
        kind = "same" if setting in seen else "known" if setting in known else "new"
        kinds.append(sys.intern(f"{kind} {setting[0]}"))
        seen.add(setting)
    return kinds


def cost_file() -> Path:
    """Return the path of the file in which costs are kept; $XDG_CACHE_HOME moves it."""
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(cache) / "labapp" / "frame-costs.json"


class FrameCosts:
    """Keep the seconds that each kind of frame cost in the last runs on a bench, in a file.

    file: may be missing or damaged.
    bench: name of the bench.
    known: settings that were taken in this session, whose pictures a simulated bench may have kept.
    """

    def __init__(self, file: Path, bench: str) -> None:
        self._file, self._bench = file, bench
        self._all = self._read()
        self._own = self._all.setdefault(bench, {})
        self.known: set[Setting] = set()

    @property
    def kinds(self) -> list[str]:
        """Return the kinds of frames whose costs were measured."""
        return list(self._own)

    def seconds(self, kind: str) -> float | None:
        """Return the usual cost of a kind of frame in seconds; None if none was measured."""
        return statistics.median(self._own[kind]) if self._own.get(kind) else None

    def add(self, measured: dict[str, float]) -> None:
        """Add the mean costs of a run, in seconds by kind, and keep them."""
        for kind, seconds in measured.items():
            self._own[kind] = [*self._own.get(kind, [])[1 - _KEPT :], round(seconds, 5)]
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._file, json.dumps(self._all, indent=1).encode())
        except OSError as error:
            log.warning("%s: the costs of frames can't be kept: %s", self._file, error)

    def _read(self) -> dict[str, dict[str, list[float]]]:
        try:
            with open_regular(self._file, _MOST_BYTES) as file:
                data = parse_json(file.read().decode(), str(self._file))
            return {
                str(bench): {
                    str(kind): [float(one) for one in listed][-_KEPT:]
                    for kind, listed in costs.items()
                }
                for bench, costs in data.items()
            }
        except (UserError, AttributeError, TypeError, ValueError) as error:
            if self._file.exists():
                log.warning("%s: the costs of frames can't be used: %s", self._file, error)
            return {}
