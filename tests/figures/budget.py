"""The choice of a restoration by time, against what every method was then seen to take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from figures import Figure
from figures.photographs import squares
from labapp.accuracy.blurs import BLURS, simulate_photograph
from labapp.accuracy.deconvolve import DeconvolutionRow, measure_deconvolution
from labapp.common.speed import machine_speed
from labapp.pictures.networks import bundled_denoiser
from optics.deconvolution.restoration_choice import METHODS
from optics.progress import Progress
from optics.threads import single_threaded

_BUDGETS = (0.05, 0.1, 0.3, 1.0, 3.0)
"""Seconds."""

_CASES = 12
_NAMES = ("disk of 5", "Gaussian of 1.5", "shake of 30", "ring of 8", "line of 15", "disk of 7")
_NOISES = (0.005, 0.01, 0.02)

_LOST, _LONGER = 0.3, 1.5


@dataclass(frozen=True)
class _Chosen:
    """lost: decibels below the best that took no longer. longer: its time over the budget."""

    lost: float
    longer: float


@single_threaded
def budget_figure(folder: Path) -> list[Figure]:
    """Pictures of 256 x 256 through 6 blurs, five budgets each."""
    name = "restoration chosen for a budget: dB below the best that takes no longer"
    goal = f"median ≤ {_LOST}; ≤ {_LONGER} times the budget in 9 of 10"
    pictures, where = squares(_CASES, 256)
    if not pictures:
        return [Figure(name, goal, where, None)]
    speed, chosen, gains = machine_speed(), list[_Chosen](), dict[tuple[str, int], list[float]]()
    for number, scene in enumerate(pictures):
        blur, noise = _NAMES[number % len(_NAMES)], _NOISES[number % len(_NOISES)]
        case = simulate_photograph(blur, scene, BLURS[blur](), noise, number)
        before, *rows = measure_deconvolution(case, bundled_denoiser(), speed, Progress())
        for row in rows:
            gain = (row.psnr_db or 0) - (before.psnr_db or 0)
            gains.setdefault((row.method, row.iterations), []).append(gain)
        chosen += [one for budget in _BUDGETS if (one := _choice(rows, budget)) is not None]
    lost = float(np.median([one.lost for one in chosen]))
    longer = float(np.quantile([one.longer for one in chosen], 0.9))
    seen = ", ".join(
        f"{method} {count}: {np.median(found):+.1f}" for (method, count), found in gains.items()
    )
    return [
        Figure(
            name,
            goal,
            f"median {lost:.2f}, 9 of 10 within {longer:.2f} times; {len(chosen)} choices {where}; "
            f"gains in dB: {seen}",
            lost <= _LOST and longer <= _LONGER,
        )
    ]


def _choice(rows: Sequence[DeconvolutionRow], budget: float) -> _Chosen | None:
    """What restore() takes for a budget, by the times that it expects; None if nothing fits."""
    fitting = [row for row in rows if (row.cpu_predicted_s or 0) <= budget]
    in_time = [row.psnr_db or 0 for row in rows if (row.cpu_s or 0) <= budget]
    if not fitting:
        return None
    taken_ = max(fitting, key=lambda row: METHODS[row.method].gains[row.iterations])
    level, spent = taken_.psnr_db or 0, taken_.cpu_s or 0
    return _Chosen(max(0.0, max(in_time, default=level) - level), spent / budget)


MEASUREMENTS = {"budget": budget_figure}
