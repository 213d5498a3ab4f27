"""Images of layers that hide each other, against a light field, and what they cost."""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median

import numpy as np
import torch
from judges.light_field import CASES, compare_compositors, sum_of_masked_layers

from figures import Figure
from optics.edof.layered_capture import composite_layers
from optics.threads import single_threaded

_SIDES, _BLUR, _SEEDS = (96, 128), 12.0, (2, 11, 12)
"""Pixels of the scenes along a side, pixels of blur per dioptre, and seeds of the scenes."""

_GOAL, _COST_GOAL = 36.0, 3.0
_COST_SIDE, _REPEATS = 512, 9


@single_threaded
def edof_layers_figures(folder: Path) -> list[Figure]:
    """The over-composite and the usual sum of masked layers, against the same light field."""
    over, masked = [], []
    for case in CASES:
        for side in _SIDES:
            for seed in _SEEDS:
                found = compare_compositors(
                    case,
                    {"over": composite_layers, "masked": sum_of_masked_layers},
                    side,
                    _BLUR,
                    seed=seed,
                )
                over.append(found["over"])
                masked.append(found["masked"])
    cost = _relative_cost()
    return [
        Figure(
            "layers that hide each other, against a light field",
            f"≥ {_GOAL:g} dB",
            f"{min(over):.1f} dB at least, median {median(over):.1f} dB, in {len(over)} scenes; "
            f"the sum of masked layers {min(masked):.1f} and {median(masked):.1f} dB",
            min(over) >= _GOAL,
        ),
        Figure(
            "processor time of two layers over that of a plane",
            f"≤ {_COST_GOAL:g}",
            f"{cost:.2f}",
            cost <= _COST_GOAL,
        ),
    ]


def _relative_cost() -> float:
    """Median over repeats of the time of two layers over that of one, one after the other."""
    generator = torch.Generator().manual_seed(1)
    side = _COST_SIDE
    pictures = torch.rand((2, side, side), generator=generator)
    mattes = torch.rand((2, side, side), generator=generator)
    mattes[-1] = 1
    transfers = torch.fft.rfft2(torch.rand((2, side, side), generator=generator) / side**2)
    ratios = []
    for _ in range(_REPEATS):
        times = []
        for layers in (slice(1, 2), slice(0, 2)):
            started = time.process_time()
            composite_layers(pictures[layers], mattes[layers], transfers[layers])
            times.append(time.process_time() - started)
        ratios.append(times[1] / times[0])
    return float(np.median(ratios))


MEASUREMENTS = {"edof-layers": edof_layers_figures}
