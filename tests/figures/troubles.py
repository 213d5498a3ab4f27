"""Every fault that simulated devices can have, at random moments: the right state, no lie."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
from small_bench.setups import random_plan, small_setup

from figures import Figure
from figures.durability import differing_arrays, run_small
from labapp.bench.opening import open_bench
from labapp.common.console import print_message
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import RunOutcome, resume_run, run_plan
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from simulator.faults import FRAME_KINDS, Fault, Kind, Role

_MOMENTS = 20

_PASSING: tuple[Kind, ...] = ("slow", "stale frame")
"""Kinds that end no run, however often they strike: a camera has nothing stale when it is
opened again, which the third attempt begins with."""

_FOR_EVER = 1000
"""Calls that a fault strikes, or seconds that it lasts, so that no retry helps."""


@dataclass(frozen=True)
class Suffered:
    """How a run with a fault ended. wrong: what isn't as it must be, empty if all is."""

    fault: Fault
    state: State
    wrong: str


def fault_figure(folder: Path) -> list[Figure]:
    """Each kind of fault at random moments of random plans; passing ones and lasting ones."""
    found = []
    for kind in get_args(Kind):
        print_message(f"  {kind}")
        found += suffer(folder, [kind], _MOMENTS)
    wrong = [f"{one.fault}: {one.wrong}" for one in found if one.wrong]
    complete = sum(one.state is State.COMPLETE for one in found)
    measured = (
        f"{len(found) - len(wrong)} of {len(found)} right: {complete} COMPLETE and whole, "
        f"{len(found) - complete} FAILED, missing frames named, resumed whole"
    )
    return [
        Figure(
            "every kind of fault at 20 random moments",
            "right state; COMPLETE only with every frame true",
            measured + (f"; first trouble: {wrong[0]}" if wrong else ""),
            not wrong,
        )
    ]


def suffer(folder: Path, kinds: Iterable[Kind], moments: int, seed: int = 0) -> list[Suffered]:
    """Run random plans with a fault of each kind at random moments."""
    found = []
    for kind in kinds:
        number = get_args(Kind).index(kind)
        for moment in range(moments):
            rng = np.random.default_rng([seed, number, moment])
            found.append(_suffer_one(folder, kind, rng))
    return found


def _suffer_one(folder: Path, kind: Kind, rng: np.random.Generator) -> Suffered:
    reference, path = folder / "whole.h5", folder / "run.h5"
    for file in (reference, path):
        file.unlink(missing_ok=True)
    plan = random_plan(rng)
    run_small(plan, reference)
    lasting = bool(rng.random() < 0.4)
    fault = _fault(kind, lasting, reference, rng)
    spared = [True]
    with open_bench(small_setup(faults=[fault])) as bench:
        assert bench.world is not None
        script = bench.world.faults
        # A fault may come after the last frame, when the bench is made safe.
        outcome = run_plan(
            bench,
            plan,
            path,
            Attendance(on_frame=lambda shot, frame: spared.append(script.is_unused)),
        )
    harmless = outcome.state is State.COMPLETE and spared[-1]
    helps = not lasting or harmless or kind in _PASSING
    expected = State.COMPLETE if helps else State.FAILED
    wrong = _judge(outcome, expected, reference, path) or _finish(reference, path)
    return Suffered(fault, outcome.state, wrong)


def _fault(kind: Kind, lasting: bool, reference: Path, rng: np.random.Generator) -> Fault:
    roles: list[Role] = ["camera"] if kind in FRAME_KINDS else list(get_args(Role))
    with Record(reference) as record:
        frame = int(rng.integers(record.frame_count))
    gone = _FOR_EVER if lasting else 0.1
    times = _FOR_EVER if lasting and kind != "disconnect" else 1
    return Fault(roles[rng.integers(len(roles))], kind, frame, times, gone)


def _judge(outcome: RunOutcome, expected: State, reference: Path, path: Path) -> str:
    """Nothing stored may differ from the undisturbed run, and what isn't there is named."""
    if outcome.state is not expected:
        return f"{outcome.state} instead of {expected}: {outcome.message}"
    with Record(reference) as whole, Record(path) as record:
        if record.state is not outcome.state or record.missing_frames() != outcome.missing:
            return f"the file says {record.state}, {len(record.missing_frames())} missing"
        if bool(outcome.missing) == (outcome.state is State.COMPLETE):
            return f"{outcome.state} with {len(outcome.missing)} frames missing"
        for index in sorted(set(range(record.frame_count)) - set(outcome.missing)):
            if not np.array_equal(record.image(index), whole.image(index)):
                return f"frame {index} isn't the one that was planned"
            for column in ("exposure", "wavelength"):
                if record.column(column)[index] != whole.column(column)[index]:
                    return f"frame {index} has another {column}"
    return ""


def _finish(reference: Path, path: Path) -> str:
    """Resumed on a sound bench, the record is as if nothing had happened."""
    with open_bench(small_setup()) as bench:
        outcome = resume_run(bench, path)
    differing = differing_arrays(reference, path)
    return f"resumed: {outcome.state}, {differing} differ" if differing else ""


MEASUREMENTS = {"faults": fault_figure}
