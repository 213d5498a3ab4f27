"""Fit the gains by which a restoration is chosen: `python -m figures.fit_gains`.

Every method restores random cases after each of its numbers of iterations, and its gain in PSNR is
fitted by the features of the case. The lines that are printed stand in the methods' METHOD.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import astuple
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from figures.restoration_cases import FITTED, random_cases
from labapp.accuracy.blurs import SimulatedPhotograph
from labapp.common.threads import use_one_thread
from labapp.pictures.networks import bundled_denoiser
from optics.inverse.choice import METHODS, restore
from optics.inverse.method import RestorationCase

_RIDGE = 3.0
"""Weight of the squared coefficients, in cases: it keeps what few cases determine small."""


def main() -> None:
    asked = _arguments()
    use_one_thread()
    with asked.rows.open("a") as file:
        for case in islice(random_cases(asked.seed, FITTED), asked.cases):
            file.write(json.dumps(measured_gains(case, asked.methods)) + "\n")
            file.flush()
    print_fits([json.loads(line) for line in asked.rows.read_text().splitlines()])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="figures.fit_gains", description=__doc__)
    parser.add_argument("rows", type=Path, help="file to which cases are added, JSON by line")
    parser.add_argument("--cases", type=int, default=200, help="number of cases to add; 0 to fit")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--methods", nargs="+", default=list(METHODS), choices=METHODS, help="all if not given"
    )
    return parser.parse_args()


def measured_gains(case: SimulatedPhotograph, names: Sequence[str]) -> dict[str, Any]:
    """The features of a case, and the gain of each method in dB by its number of iterations."""
    denoise, before = bundled_denoiser(), case.quality(case.observation)[0]
    gains = {
        name: {
            count: case.quality(
                restore(case.problem, None, name, count=count, denoise=denoise).image
            )[0]
            - before
            for count in METHODS[name].gains
        }
        for name in names
    }
    return {"features": astuple(RestorationCase.of(case.problem)), "gains": gains}


def print_fits(rows: list[dict[str, Any]]) -> None:
    """Print each method's gains as they stand in its METHOD."""
    for name, method in METHODS.items():
        own = [row for row in rows if name in row["gains"]]
        features = np.array([[1.0, *row["features"]] for row in own])
        print(f"{name}, {len(own)} cases")
        for count in method.gains if own else ():
            gains = np.array([row["gains"][name][str(count)] for row in own])
            normal = features.T @ features + _RIDGE * np.diag([0, 1, 1, 1, 1, 1])
            fit = np.linalg.solve(normal, features.T @ gains)
            left = float(np.std(gains - features @ fit))
            values = ", ".join(f"{value:.2f}" for value in fit)
            print(f"    {count}: Gain({values}),  # least {gains.min():.1f}, rms {left:.1f}")


if __name__ == "__main__":
    main()
