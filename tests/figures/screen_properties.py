"""Screens whose card is set wrong before a run and during one: what is named, and what is taken."""

from __future__ import annotations

import subprocess
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Frame, Surroundings
from drivers.screen import ScreenSLM
from drivers.x11 import XError
from figures import Figure
from figures.card_drivers import DRIVERS
from figures.spoiled_screens import (
    Desk,
    Spoiling,
    add_panel,
    desk,
    listening,
    properties_of,
    setup_on,
)
from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from labapp.runs.steps import Shot
from simulator.screens import xorg

_SEED = 55
_BEFORE, _SOUND = 15, 5
"""Screens for each driver that are wrong, and that are sound, before anything opens them."""

_EVERY = 3
"""Frames from one change to the next."""

_FRAMES = 36
_LONG = 0.3
"""Seconds of every other exposure."""

_KINDS = ("property", "property", "property", "brief", "ramp", "panning")
"""What is drawn for a change. "brief" is a property that is set back before the exposure ends."""

_AWAY = 1.0
"""Seconds for which something is altered that labapp may not set right."""

_BRIEF = 0.03


@dataclass
class Opened:
    """Screens opened when something was wrong; `silent`: without a word, or left wrong; `kept`: set
    right and not put back. Sound ones, and those of them that were refused or that something was
    said of."""

    wrong: int = 0
    silent: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    sound: int = 0
    refused: list[str] = field(default_factory=list)


@dataclass
class Ran:
    """Changes during runs: `unnamed` before the next frame was accepted. Frames, and those that
    were accepted although they were exposed while something was altered. states: how runs ended."""

    changes: int = 0
    unnamed: list[str] = field(default_factory=list)
    frames: int = 0
    altered: list[str] = field(default_factory=list)
    states: list[State] = field(default_factory=list)
    again: int = 0


@dataclass
class Change:
    """began, done: times by time.monotonic() around what altered the screen; over: when that was
    seen to be gone."""

    spoiling: Spoiling
    began: float
    done: float = 0.0
    over: float = float("inf")


def properties_figure(folder: Path) -> list[Figure]:
    """Every driver's properties, gamma ramps and panning, drawn by chance."""
    names = (
        "screen properties of 4 card drivers, gamma ramps, panning wrong before a screen is opened",
        "screens with sound properties opened, and run on while others touch what alters nothing",
        "screen properties, gamma ramps, panning changed while a run takes frames",
    )
    goals = (
        "all set right or refused by name; put back",
        "0 refused or doubted",
        "all named before the next accepted frame; 0 frames of altered screens accepted",
    )
    rng, opened, ran, quiet = np.random.default_rng(_SEED), Opened(), Ran(), Ran()
    try:
        with xorg(folder) as server:
            add_panel(server)
            for driver in DRIVERS:
                for wrong in [True] * _BEFORE + [False] * _SOUND:
                    with desk(server, driver, rng) as made:
                        open_once(made, opened, rng, wrong=wrong)
                with desk(server, driver, rng) as made:
                    run_once(made, ran, folder / f"{driver}.h5", rng, _KINDS)
                with desk(server, driver, rng) as made:
                    run_once(made, quiet, folder / f"{driver}-quiet.h5", rng, ())
    except (OSError, subprocess.SubprocessError, DeviceError, XError, UserError) as error:
        return [
            Figure(name, goal, f"not measured: {error}", None)
            for name, goal in zip(names, goals, strict=True)
        ]
    before = (
        f"{len(opened.silent)} of {opened.wrong} without a word, {len(opened.kept)} not put back"
    )
    sound = (
        f"{len(opened.refused)} of {opened.sound} screens, {quiet.again} of {quiet.frames} frames"
    )
    during = (
        f"{len(ran.unnamed)} of {ran.changes} not named, {len(ran.altered)} of {ran.frames} frames "
        f"altered and accepted; {ran.again} taken again"
    )
    complete = all(state is State.COMPLETE for state in (*ran.states, *quiet.states))
    return [
        Figure(names[0], goals[0], before, not opened.silent and not opened.kept),
        Figure(names[1], goals[1], sound, not opened.refused and not quiet.again and complete),
        Figure(names[2], goals[2], during, not ran.unnamed and not ran.altered and complete),
    ]


def open_once(made: Desk, found: Opened, rng: np.random.Generator, *, wrong: bool) -> None:
    """Open a screen on which something is wrong, or nothing, and add to what was found."""
    spoiling = made.spoil(str(rng.choice(_KINDS)).replace("brief", "property")) if wrong else None
    if spoiling:
        spoiling.apply()
    before, during = properties_of(made.server), list[str]()
    error = ""
    options = setup_on(made.server).bench.devices.slm.options
    with listening() as ear:
        try:
            with ScreenSLM(Surroundings(RealClock()), **options):
                during = made.altered()
        except DeviceError as failure:
            error = str(failure)
    said = "; ".join([error, *(words for _, words in ear.heard)]).strip("; ")
    if spoiling is None:
        found.sound += 1
        found.refused += [said] if said else []
        return
    found.wrong += 1
    if spoiling.word not in said or during or (not error and not spoiling.is_settable):
        found.silent.append(f"{spoiling.word}: {said or 'nothing'} {during}")
    if properties_of(made.server) != before:
        found.kept.append(spoiling.word)
    spoiling.undo()


def run_once(
    made: Desk,
    found: Ran,
    path: Path,
    rng: np.random.Generator,
    kinds: tuple[str, ...],
    frames: int = _FRAMES,
) -> None:
    """Run a plan while somebody changes the screen after every few frames; without kinds, nothing
    that matters."""
    changes: list[Change] = []
    accepted: list[float] = []
    threads: list[threading.Thread] = []

    def look(shot: Shot, frame: Frame) -> None:
        accepted.append(time.monotonic())
        if shot.index % _EVERY or shot.index + 2 >= frames:
            return
        later = float(rng.uniform(0, _LONG))
        kind = str(rng.choice(kinds)) if kinds else ""
        threads.append(threading.Thread(target=_change, args=(made, changes, kind, later)))
        threads[-1].start()

    setup = setup_on(made.server)
    with listening() as ear, open_bench(setup) as bench:
        offset = time.monotonic() - bench.clock.now()
        outcome = run_plan(bench, _plan(frames), path, Attendance(on_frame=look))
        for thread in threads:
            thread.join()
    with Record(outcome.path) as record:
        begins = record.column("time") + offset
        ends = begins + record.column("exposure")
        found.again += int((record.column("attempts") > 1).sum())
    found.states.append(outcome.state)
    found.frames += len(accepted)
    found.changes += len(changes)
    for change in changes:
        word = change.spoiling.word
        after = [at for at, end in zip(accepted, ends, strict=False) if end > change.done]
        if not ear.named(word, change.began, min(after, default=float("inf"))):
            found.unnamed.append(word)
        inside = (begins[: len(accepted)] < change.over) & (ends[: len(accepted)] > change.done)
        found.altered += [f"{word}: frame {n}" for n in np.flatnonzero(inside)]


def _change(made: Desk, changes: list[Change], kind: str, later: float) -> None:
    """Change something a moment later, and see to it that it is altered no longer."""
    time.sleep(later)
    if not kind:
        made.touch_something_else()
        return
    spoiling = made.spoil(kind.replace("brief", "property"))
    change = Change(spoiling, time.monotonic())
    changes.append(change)
    spoiling.apply()
    change.done = time.monotonic()
    if kind == "property":
        # labapp sets it right; until then, this sees that it is altered.
        late = change.done + 30.0
        while time.monotonic() < late:
            asked = time.monotonic()
            if spoiling.word not in made.altered():
                break
            change.over = asked
        change.over = change.over if change.over < late else change.done
        return
    time.sleep(_BRIEF if kind == "brief" else _AWAY)
    change.over = time.monotonic()
    spoiling.undo()


def _plan(frames: int) -> PlanFile:
    block = {
        "targets": ["star"],
        "patterns": ["neutral", "lens"],
        "wavelengths_nm": [500],
        "exposures_ms": [20, _LONG * 1e3],
        "repeats": frames // 4,
        "order": ["repeat", "pattern", "target", "wavelength", "exposure"],
    }
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": "Spoiled screens",
            "retry": {"attempts": 12, "wait_s": 0.2},
            "patterns": {
                "neutral": {"kind": "constant"},
                "lens": {"kind": "lens", "focal_length_m": 50.0},
            },
            "acquire": [block],
        }
    )


MEASUREMENTS = {"screen properties": properties_figure}
