"""Energy of the demo's star by aperture, against the simulator's noise-free light."""

from __future__ import annotations

import itertools
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from figures import Figure
from labapp.pictures.analysis.brackets import dark_target, find_brackets, recorded_bracket
from labapp.runs.record.reader import Record
from labapp.studies.demo import run_first_light
from optics.hdr import CLIPPED, MOVED, Bracket, merge

GOAL = 3.0
DECADES = 6


@dataclass(frozen=True)
class StarEnergy:
    """Energy of the demo's star less that of the noise-free light, in stated standard deviations.

    rings, apertures: one for each decade of light below the peak. moved: share of pixels that are
    said to contradict themselves.
    """

    rings: list[float]
    apertures: list[float]
    moved: float

    @property
    def worst(self) -> float:
        """Largest deviation of all."""
        return max(map(abs, (*self.rings, *self.apertures)))


def measure_star(path: Path, folder: Path) -> StarEnergy:
    """The star behind the neutral pattern, by rings of one decade of light each around its peak.

    path: the demo's record. The light is that of the longest exposure that isn't clipped, since
    the simulator decides for each exposure which faint light is left out within the scene's
    tolerance.
    """
    with Record(path) as record:
        (found,) = (
            one for one in find_brackets(record) if (one.target, one.pattern) == ("star", "neutral")
        )
        sensor = record.bench.build_camera().sensor
        bracket = recorded_bracket(record, found.frames, dark_target(record.plan), sensor)
    light = _noise_free_light(bracket, found.wavelength, folder)
    merged = merge(bracket)
    state, rate = merged.state.numpy(), merged.rate.double().numpy()
    variance, away = merged.variance.double().numpy(), _away(light)
    rings, apertures = list[float](), list[float]()
    for inner, outer in _radii(light):
        for least, kept in ((0.0, apertures), (inner, rings)):
            inside = (least <= away) & (away < outer) & (state != CLIPPED)
            spread = np.sqrt(variance[inside].sum())
            kept.append(float((rate - light)[inside].sum() / spread))
    return StarEnergy(rings, apertures, float((state == MOVED).mean()))


def star_energy_figures(folder: Path) -> list[Figure]:
    """Energy of the demo's star, each decade below its peak."""
    run_first_light(folder)
    found = measure_star(folder / "run.h5", folder)
    return [
        Figure(
            "the demo's star, energy in rings and apertures of one decade of light each, less the "
            "noise-free light",
            f"≤ {GOAL:g} stated σ",
            f"rings {', '.join(f'{one:+.1f}' for one in found.rings)}; apertures "
            + ", ".join(f"{one:+.1f}" for one in found.apertures),
            len(found.rings) >= DECADES - 1 and found.worst <= GOAL,
        ),
        Figure(
            "pixels of the demo's star that are said to contradict themselves",
            "≤ .1 %",
            f"{found.moved:.3%}",
            found.moved <= 1e-3,
        ),
    ]


def _noise_free_light(bracket: Bracket, wavelength: float, folder: Path) -> np.ndarray:
    """Electrons per second, of each pixel's longest exposure that isn't clipped."""
    found: np.ndarray | None = None
    for exposure in bracket.exposures:
        path = folder / f"light-{exposure.time * 1e3:g}.h5"
        subprocess.run(
            [sys.executable, "-m", "labapp", "simulate", "--target", "star", "--wavelength-nm",
             f"{wavelength * 1e9:g}", "--exposure-ms", f"{exposure.time * 1e3:g}", "--out",
             str(path), "--force"],
            check=True, capture_output=True,
        )  # fmt: skip
        with h5py.File(path) as file:
            electrons = file["electrons"][:].astype(np.float64)
        light = electrons / exposure.time
        found = light if found is None else np.where(electrons < exposure.clip_level, light, found)
    assert found is not None
    return found


def _away(light: np.ndarray) -> np.ndarray:
    """Distance of each pixel from the brightest one, in pixels."""
    row, column = np.unravel_index(light.argmax(), light.shape)
    rows, columns = np.indices(light.shape)
    return np.asarray(np.hypot(rows - row, columns - column))


def _radii(light: np.ndarray) -> list[tuple[float, float]]:
    """Rings in which the mean light around the peak falls by a decade each."""
    number = np.round(_away(light)).astype(int).ravel()
    profile = np.bincount(number, light.ravel()) / np.bincount(number)
    edges = [0.0]
    for decade in range(1, DECADES + 1):
        below = np.flatnonzero(profile < light.max() / 10**decade)
        if below.size and below[0] - 0.5 > edges[-1]:
            edges.append(float(below[0]) - 0.5)
    return list(itertools.pairwise(edges))


MEASUREMENTS = {"star-energy": star_energy_figures}
