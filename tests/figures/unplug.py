"""Runs whose devices lose their plugs: what is said how soon, and how the runs end."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import DeviceError
from drivers.interfaces import Frame
from figures import Figure, plugs
from figures.plugs import Plug, Seen, checksum_of
from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.shots import Shot
from labapp.runs.state import State
from optics.progress import Progress

_TIMES = 5
_NAMED = 1.0
_AWAY = 1.5
"""Seconds for which a plug is out."""

_LONG = 1.2
"""Seconds of every other exposure: longer than a pull may stay unnoticed."""

_PATTERNS: dict[str, dict[str, Any]] = {
    "neutral": {"kind": "constant"},
    "lens": {"kind": "lens", "focal_length_m": 50.0},
}

_GOAL = f"named within {_NAMED:g} s, the run goes on to COMPLETE without a restart"

Make = Callable[[Path], AbstractContextManager[Plug]]


@dataclass(frozen=True)
class Unplugged:
    """state: the run's. named: seconds from the pull to the first word of the device.
    right: frames, of how many were `asked`, that are of what was planned. again: of those
    that had to be taken more than once. said: what a person was shown meanwhile."""

    state: State
    named: float
    asked: int
    right: int
    again: int
    said: list[str]


def unplug_figure(folder: Path) -> list[Figure]:
    """Each device behind its wire is unplugged at random moments of runs."""
    kinds: dict[str, Make] = {
        "filter unplugged during a run, and plugged in again": plugs.varispec,
        "Thorlabs wheel unplugged during a run, and plugged in again": plugs.thorlabs,
        "USB wheel unplugged during a run, and plugged in again": plugs.zwo,
        "GigE camera unplugged during a run, and plugged in again": plugs.gige,
        "SLM's screen switched off during a run, and on again": plugs.screen,
        "SLM's X server ended during a run, and started again": plugs.x_server,
    }
    return [_figure(name, make, folder / str(n)) for n, (name, make) in enumerate(kinds.items())]


def _figure(name: str, make: Make, folder: Path) -> Figure:
    folder.mkdir()
    rng = np.random.default_rng(0)
    try:
        runs = [
            unplugged_run(make, folder / str(n), int(rng.integers(1, 7)), rng.uniform(0, _LONG))
            for n in range(_TIMES)
        ]
    except (OSError, UserError, DeviceError) as error:
        return Figure(name, _GOAL, f"not measured: {error}", None)
    slowest = max(run.named for run in runs)
    ended = sum(run.state is State.COMPLETE and run.right == run.asked for run in runs)
    again = sum(run.again for run in runs)
    measured = f"{slowest:.2f} s, slowest of {_TIMES}; {ended} of {_TIMES} COMPLETE, all frames "
    measured += f"as planned, {again} of them taken again"
    return Figure(name, _GOAL, measured, slowest <= _NAMED and ended == _TIMES)


def unplugged_run(
    make: Make, folder: Path, after: int, later: float, patterns: Sequence[str] = tuple(_PATTERNS)
) -> Unplugged:
    """A run of four frames a pattern; the plug is pulled so many seconds after so many of them.

    Every other frame is exposed so long that the device has to be named before that is over.
    """
    folder.mkdir()
    pulled: list[float] = []
    told: list[float] = []
    right: dict[int, str] = {}
    said: list[str] = []

    with make(folder) as plug, open_bench(plug.setup) as bench:

        def pull() -> None:
            pulled.append(time.monotonic())
            plug.pull(_AWAY)

        def look(shot: Shot, frame: Frame) -> None:
            if plug.is_right(shot, frame):
                right[shot.index] = shot.pattern
            if shot.index + 1 == after:
                threading.Timer(later, pull).start()

        began = time.monotonic() - bench.clock.now()
        names = {plug.role, bench.supervised_devices[plug.role].identity.model}
        with _first_word(told, pulled, names):
            outcome = run_plan(
                bench,
                plan_of(patterns),
                folder / "run.h5",
                Attendance(
                    progress=Progress(lambda share, words: said.append(words)), on_frame=look
                ),
            )
    with Record(outcome.path) as record:
        again = int((record.column("attempts") > 1).sum())
        if plug.seen:
            stood = [n for n, name in right.items() if _stood(record, n, name, plug.seen, began)]
            right = {n: right[n] for n in stood}
    named = told[0] - pulled[0] if told else float("inf")
    return Unplugged(outcome.state, named, 4 * len(patterns), len(right), again, said)


def _stood(record: Record, index: int, name: str, seen: Seen, began: float) -> bool:
    """Whether somebody who looked at the screen saw the frame's pattern all the time.

    began: time.monotonic() at which the bench's clock was 0.
    """
    start = record.column("time")[index] + began
    end = start + record.column("exposure")[index]
    wanted = checksum_of(record.pattern(name))
    stood = [value for at, value in seen if start <= at <= end]
    # A short exposure may fall between two looks.
    return all(value == wanted for value in stood) and (bool(stood) or end - start < 0.1)


def plan_of(patterns: Sequence[str]) -> PlanFile:
    """Two wavelengths, each with a short exposure and a long one; device failures as ever."""
    block = {
        "targets": ["star"],
        "patterns": list(patterns),
        "wavelengths_nm": [500, 550],
        "exposures_ms": [20, _LONG * 1e3],
    }
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": "Unplugged",
            "patterns": {name: _PATTERNS[name] for name in patterns},
            "acquire": [block],
        }
    )


@contextmanager
def _first_word(told: list[float], pulled: list[float], names: set[str]) -> Iterator[None]:
    """When the log first warns of the device, by one of its names, after its plug was pulled."""

    class Ear(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            words = record.getMessage()
            if pulled and not told and any(name in words for name in names):
                told.append(time.monotonic())

    ear, logger = Ear(logging.WARNING), logging.getLogger("labapp")
    logger.addHandler(ear)
    try:
        yield
    finally:
        logger.removeHandler(ear)


MEASUREMENTS = {"unplug": unplug_figure}
