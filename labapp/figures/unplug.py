"""A run whose filter loses its plug: what is said how soon, and how the run ends."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.interfaces import Frame
from labapp.acquisition.runner import run_plan
from labapp.acquisition.state import State
from labapp.acquisition.steps import Shot
from labapp.bench import BenchSetup, open_bench
from labapp.figures import Figure
from labapp.figures.small_bench import small_setup
from labapp.files.bench_file import DeviceTable
from labapp.files.plan_file import PlanFile
from simulator.machines.varispec import VariSpecMachine
from simulator.wire import Line, WireFault
from simulator.wire.pty import ServedLine

_TIMES = 5
_GOAL = 1.0
_AWAY = 1.5
"""Seconds for which the plug is out."""


@dataclass(frozen=True)
class Unplugged:
    """state: the run's. named: seconds from the pull to the first word of the filter.
    frames: of how many were `asked`, at the wavelengths that were asked for."""

    state: State
    named: float
    frames: int
    asked: int


def unplug_figure(folder: Path) -> list[Figure]:
    """A VariSpec behind a pseudo-terminal is unplugged in the middle of runs."""
    runs = [unplugged_run(folder / f"unplugged-{n}", 2 + n) for n in range(_TIMES)]
    slowest = max(run.named for run in runs)
    ended = sum(run.state is State.COMPLETE and run.frames == run.asked for run in runs)
    return [
        Figure(
            "filter unplugged during a run, and plugged in again",
            f"named within {_GOAL:g} s, the run goes on to COMPLETE without a restart",
            f"{slowest:.2f} s, slowest of {_TIMES}; {ended} of {_TIMES} COMPLETE",
            slowest <= _GOAL and ended == _TIMES,
        )
    ]


def unplugged_run(folder: Path, after: int) -> Unplugged:
    """One run of eight frames at eight wavelengths; the plug is pulled after so many."""
    folder.mkdir()
    line = Line(VariSpecMachine(), baudrate=9600)
    pulled: list[float] = []
    told: list[float] = []
    seen: list[Frame] = []

    with ServedLine(line, folder / "filter") as served, _first_word(told, pulled):

        def pull(shot: Shot, frame: Frame) -> None:
            seen.append(frame)
            if len(seen) == after:
                pulled.append(time.monotonic())
                line.inject(WireFault("disconnect", served.clock.now(), _AWAY))

        with open_bench(_setup(served.path)) as bench:
            outcome = run_plan(bench, _plan(), folder / "run.h5", on_frame=pull)
    return Unplugged(outcome.state, told[0] - pulled[0] if told else 1e9, len(seen), 8)


def _setup(port: Path) -> BenchSetup:
    setup = small_setup(reply_s=30.0)
    table = DeviceTable(driver="varispec", options={"port": str(port)}, simulated=True)
    devices = setup.bench.devices.model_copy(update={"filter": table})
    return replace(setup, bench=setup.bench.model_copy(update={"devices": devices}))


def _plan() -> PlanFile:
    block = {
        "targets": ["star"],
        "patterns": ["neutral"],
        "wavelengths_nm": [450, 480, 510, 540, 570, 600, 630, 660],
        "exposures_ms": [2],
    }
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": "Unplugged",
            "patterns": {"neutral": {"kind": "constant"}},
            "retry": {"attempts": 20, "wait_s": 0.2},
            "acquire": [block],
        }
    )


@contextmanager
def _first_word(told: list[float], pulled: list[float]) -> Iterator[None]:
    """When the log first speaks of the filter after the plug was pulled."""

    class Ear(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if pulled and not told and "VariSpec" in record.getMessage():
                told.append(time.monotonic())

    ear, logger = Ear(logging.WARNING), logging.getLogger("labapp")
    logger.addHandler(ear)
    try:
        yield
    finally:
        logger.removeHandler(ear)
