"""That the same seed gives the same data, and that a killed run loses nothing and goes on."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from small_bench.setups import random_plan, small_setup

from figures import Figure
from figures.victim import Victims
from labapp.bench.opening import open_bench
from labapp.common.console import print_message
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.runner import RunOutcome, resume_run, run_plan
from labapp.runs.record.reader import Record
from labapp.runs.state import State

_KILLS = 200

_PATIENCE = 60.0
"""Seconds after which a run that hasn't begun won't."""


def same_seed(folder: Path) -> list[Figure]:
    """Two runs of a plan, array by array."""
    plan = random_plan(np.random.default_rng(0))
    records = [folder / "first.h5", folder / "second.h5"]
    for path in records:
        run_small(plan, path)
    differing = differing_arrays(*records)
    measured = "all equal" if not differing else f"{', '.join(differing)} differ"
    return [
        Figure(
            "arrays of two runs with the same seed", "equal bit for bit", measured, not differing
        )
    ]


def run_small(plan: PlanFile, path: Path) -> RunOutcome:
    with open_bench(small_setup()) as bench:
        return run_plan(bench, plan, path)


def differing_arrays(first: Path, second: Path) -> list[str]:
    """Names of the arrays that aren't the same in two records, bit for bit."""
    with Record(first) as a, Record(second) as b:
        left, right = a.seeded_arrays(), b.seeded_arrays()
    names = left.keys() | right.keys()
    return sorted(name for name in names if not _same(left.get(name), right.get(name)))


def _same(a: NDArray[Any] | None, b: NDArray[Any] | None) -> bool:
    """Bit for bit, so that NaN equals itself; texts by their letters."""
    if a is None or b is None or a.dtype != b.dtype or a.shape != b.shape:
        return False
    return a.tolist() == b.tolist() if a.dtype.hasobject else a.tobytes() == b.tobytes()


@dataclass(frozen=True)
class Killed:
    """What a killed run left behind. acknowledged, lost: frames. wrong: what isn't as it must."""

    acknowledged: int
    lost: int
    wrong: str


def after_kills(folder: Path) -> list[Figure]:
    """Random plans killed at random moments, and resumed; some are killed again in that."""
    found = kill_often(folder, _KILLS)
    lost = sum(one.lost for one in found)
    wrong = [one.wrong for one in found if one.wrong]
    frames = sum(one.acknowledged for one in found)
    measured = f"{lost} of {frames} frames lost, {len(found) - len(wrong)} as they must be"
    if wrong:
        measured += f"; first trouble: {wrong[0]}"
    return [
        Figure(
            "200 kill -9 at random moments, then resumed",
            "0 frames lost, INTERRUPTED, arrays as uninterrupted",
            measured,
            not lost and not wrong,
        )
    ]


def kill_often(folder: Path, kills: int, seed: int = 0) -> list[Killed]:
    """Random plans of a seed, each killed once or twice, until `kills` records are left.

    A run that was killed before its record had a name has left nothing, and isn't counted.
    """
    found: list[Killed] = []
    with Victims() as victims:
        for number in count():
            if len(found) == kills:
                return found
            killed = _kill_one(folder, np.random.default_rng([seed, number]), victims)
            if killed is not None:
                found.append(killed)
                if len(found) % 20 == 0:
                    print_message(f"  {len(found)} of {kills} kills")
    return found


def _kill_one(folder: Path, rng: np.random.Generator, victims: Victims) -> Killed | None:
    reference, path, acknowledged = (folder / n for n in ("whole.h5", "killed.h5", "frames.txt"))
    for file in (reference, path, acknowledged):
        file.unlink(missing_ok=True)
    plan = random_plan(rng)
    victims.begin(reference, acknowledged, plan)
    _wait_for(reference)
    began = time.perf_counter()
    victims.end()
    lasts = time.perf_counter() - began
    acknowledged.unlink()
    while not _kill(plan, path, acknowledged, rng.random() * lasts, victims):
        path.unlink(missing_ok=True)
        acknowledged.unlink(missing_ok=True)
    if not path.is_file():
        return None
    wrong, lost = _look(path, acknowledged)
    if rng.random() < 0.3 and _kill(None, path, acknowledged, rng.random() * lasts, victims):
        again, lost_again = _look(path, acknowledged)
        wrong, lost = wrong or again, lost + lost_again
    with open_bench(small_setup()) as bench:
        outcome = resume_run(bench, path)
    if outcome.state is not State.COMPLETE:
        wrong = wrong or f"resumed: {outcome.state}"
    differing = differing_arrays(reference, path)
    wrong = wrong or (f"{', '.join(differing)} differ" if differing else "")
    return Killed(len(_indices(acknowledged)), lost, wrong)


def _kill(
    plan: PlanFile | None, path: Path, acknowledged: Path, after: float, victims: Victims
) -> bool:
    """Begin a run and kill it some seconds after its record has a name; False if it had ended by
    then."""
    process = victims.begin(path, acknowledged, plan)
    _wait_for(path)
    time.sleep(after)
    return victims.kill(process)


def _wait_for(path: Path) -> None:
    """Until a file is there: what comes before it is planning, and leaves nothing behind."""
    late = time.monotonic() + _PATIENCE
    while not path.is_file() and time.monotonic() < late:
        time.sleep(0.001)


def _look(path: Path, acknowledged: Path) -> tuple[str, int]:
    """What is wrong with a killed record, and how many acknowledged frames it lacks."""
    with Record(path) as record:
        state, missing = record.state, set(record.missing_frames())
    # Killed between its last frame and its last word, a run may have said COMPLETE.
    right = state is State.INTERRUPTED or (state is State.COMPLETE and not missing)
    return "" if right else f"reads {state}", len(missing & set(_indices(acknowledged)))


def _indices(acknowledged: Path) -> list[int]:
    return [int(line) for line in acknowledged.read_text().split()] if acknowledged.exists() else []


MEASUREMENTS = {"seed": same_seed, "kill": after_kills}
