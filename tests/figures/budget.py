"""The choice of a restoration by time, against what every method was then seen to gain."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from figures import Figure
from figures.photographs import collection_words
from figures.restoration_cases import CHECKED, random_cases
from labapp.accuracy.blurs import SimulatedPhotograph
from labapp.common.speed import machine_speed
from labapp.pictures.networks import bundled_denoiser
from optics.accuracy import MachineSpeed
from optics.inverse.choice import METHODS, choose_method, restore
from optics.progress import Progress
from optics.threads import single_threaded

_BUDGETS = 0.02 * 2.0 ** np.arange(9)
"""Seconds."""

_CASES, _SEED = 30, 11
_LOST, _LONGER = 0.05, 1.5
_REGRET, _WORST_REGRET = 0.4, 1.5


@dataclass(frozen=True)
class _Row:
    """A method after a number of iterations: its gain in dB, its time as foretold and as seen."""

    gain: float
    predicted: float
    spent: float


@single_threaded
def budget_figure(folder: Path) -> list[Figure]:
    """Random cases that didn't fit the gains, nine budgets from 0.02 to 5 s."""
    speed, lost, regret, longer = machine_speed(Progress()), [], [], []
    for case in islice(random_cases(_SEED, CHECKED), _CASES):
        rows = _measure_methods(case, speed)
        before: float | None = None
        for budget in _BUDGETS:
            fitting = [row.gain for row in rows.values() if row.predicted <= budget]
            if not fitting:
                continue
            row = rows[choose_method(case.problem, budget, denoise=_DENOISE, speed=speed)]
            regret.append(max(fitting) - row.gain)
            longer.append(row.spent / budget)
            if before is not None:
                lost.append(before - row.gain)
            before = row.gain
    where = f"{len(regret)} choices in {_CASES} cases {collection_words(CHECKED)}"
    ninth, median, worst = (float(np.quantile(regret, share)) for share in (0.9, 0.5, 1.0))
    most, few = max(lost), float(np.mean(np.array(lost) > _LOST))
    late = float(np.quantile(longer, 0.9))
    return [
        Figure(
            "restoration chosen for a budget: dB lost where the budget is doubled",
            f"≤ {_LOST}",
            f"at most {most:.2f}, more than {_LOST} in {few:.1%}; {where}",
            most <= _LOST,
        ),
        Figure(
            "restoration chosen for a budget: dB below the best that fits",
            f"median ≤ {_REGRET}, worst ≤ {_WORST_REGRET}",
            f"median {median:.2f}, nine tenths below {ninth:.2f}, worst {worst:.2f}; {where}",
            median <= _REGRET and worst <= _WORST_REGRET,
        ),
        Figure(
            "restoration chosen for a budget: its time",
            f"≤ {_LONGER} times the budget in 9 of 10",
            f"9 of 10 within {late:.2f} times; {where}",
            late <= _LONGER,
        ),
    ]


_DENOISE = bundled_denoiser()


def _measure_methods(case: SimulatedPhotograph, speed: MachineSpeed) -> dict[tuple[str, int], _Row]:
    """Every method that isn't far dearer than the others, after each number of iterations."""
    found, before = {}, case.quality(case.observation)[0]
    for name, method in METHODS.items():
        for count in method.gains if name != "l-bfgs-b" else ():
            started = time.process_time()
            image = restore(case.problem, None, name, count=count, denoise=_DENOISE).image
            spent = time.process_time() - started
            predicted = method.seconds(case.problem, count, speed)
            found[name, count] = _Row(case.quality(image)[0] - before, predicted, spent)
    return found


MEASUREMENTS = {"budget": budget_figure}
