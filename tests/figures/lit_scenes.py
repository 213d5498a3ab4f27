"""Lit scenes drawn by chance, from a few photons to full wells: whether estimates keep tol, and
whether a plan with its picture costs less than everything on."""

from __future__ import annotations

import math
import pickle
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from figures import Figure
from figures.problems import log_uniform
from figures.random_benches import random_bench
from figures.random_pictures import (
    Case,
    TooLong,
    affordable_case,
    deviation,
    everything,
    lit,
)
from figures.random_targets import Chance
from labapp.common.console import print_message
from optics.camera import Camera
from optics.camera.pupil import pupil_amplitude
from optics.light import Band
from optics.patterns import (
    axicon,
    binary_grating,
    blazed_grating,
    cubic_phase_mask,
    fresnel_lens,
)
from optics.slm import phase_to_grey
from optics.threads import single_threaded
from simulator.panel_content import PanelContent
from simulator.situation import Situation

_FEWEST = 0.05
"""Electrons in the mean pixel of the dimmest pictures."""

_COUNT, _SEED, _MOST_WORK, _PATIENCE = 250, 20261128, 5e8, 4.0
"""Scenes, and operations and seconds of processor time for everything of one, at most."""

_MOST_DRAWN = 5000

_TOLERANCES = (1e-1, 1e-2, 1e-3)

_DEARER = 1.1
"""Times the processor time of everything on from which on a plan with its picture is dearer."""

Array = NDArray[np.float64]


def lit_situation(rng: np.random.Generator) -> Situation | None:
    """None where no light meets the sensor."""
    bench = random_bench(rng)
    if not pupil_amplitude(bench.camera).any():
        return None
    band = _band(rng)
    target = Chance(rng, bench.camera, bench.distance).target(band.centre)
    shown = PanelContent.of(_grey(rng, bench.camera, band.centre)[None], math.inf)
    s = Situation(
        bench.camera, bench.mount, lit(target, 1.0), band, shown,
        float(rng.uniform(0, 0.1)), log_uniform(rng, 1e-3, 0.1), bench.path,
    )  # fmt: skip
    rate = s.picture_probe.total / math.prod(s.camera.sensor.shape)
    if rate * s.exposure < 1e-9 * s.picture_probe.brightest * s.exposure or not rate:
        return None
    wanted = log_uniform(rng, _FEWEST, s.camera.sensor.full_well)
    return replace(s, target=lit(target, wanted / (rate * s.exposure)))


def _band(rng: np.random.Generator) -> Band:
    centre = float(rng.uniform(440e-9, 680e-9))
    if rng.random() < 0.5:
        return Band(centre, log_uniform(rng, 5e-9, 40e-9), "lyot")
    return Band(centre, log_uniform(rng, 2e-9, 60e-9), "gaussian")


def _grey(rng: np.random.Generator, camera: Camera, wavelength: float) -> NDArray[np.uint8]:
    panel = replace(camera.panel, response=None, flatness=None)
    z, (rows, columns) = camera.lens.image_distance, panel.shape
    y, x = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : columns * 1j]
    i, j = np.indices(panel.shape)
    r2, angle = x**2 + y**2, np.arctan2(y, x)
    spot = wavelength * z / (max(panel.shape) * panel.pitch)
    sign, turns = float(rng.choice([-1, 1])), rng.uniform(0.5, 8)
    period, direction = rng.uniform(2.5, 20), rng.uniform(0, 2 * math.pi)
    kinds: tuple[Callable[[], torch.Tensor | Array], ...] = (
        lambda: np.zeros(panel.shape),
        lambda: fresnel_lens(panel, sign * log_uniform(rng, 0.3, 20), wavelength),
        lambda: axicon(panel, rng.uniform(1, 8) * spot, z, wavelength),
        lambda: blazed_grating(panel, period, direction),
        lambda: blazed_grating(panel, rng.uniform(2, 4), direction),
        lambda: binary_grating(panel, int(rng.integers(2, 12)), rng.uniform(0.5, math.pi)),
        lambda: turns * np.sin(2 * math.pi * j / period),
        lambda: cubic_phase_mask(panel, rng.uniform(1, 12)),
        lambda: 2 * math.pi * turns * (2 * r2 - 1),
        lambda: 2 * math.pi * turns * r2**2,
        lambda: turns * r2 * np.cos(2 * angle),
        lambda: turns * x * (3 * r2 - 2),
        lambda: sign * int(rng.integers(1, 6)) * angle,
        lambda: int(rng.integers(1, 6)) * angle + 2 * math.pi * turns * r2,
        lambda: rng.uniform(0, rng.uniform(0.3, 6.28), panel.shape),
        lambda: math.pi * rng.integers(0, 2, panel.shape),
        lambda: np.kron(rng.uniform(0, 6.28, (8, 8)), np.ones((5, 5)))[:rows, :columns],
        lambda: math.pi * ((i + j) % 2),
        lambda: math.pi * (r2 < rng.uniform(0.1, 0.8)),
        lambda: math.pi * (np.floor(r2 * rng.uniform(2, 8)) % 2),
        lambda: turns * np.abs(x) * 2 * math.pi,
        lambda: np.angle(np.exp(1j * turns * 5 * x) + np.exp(1j * turns * 4 * y)),
        lambda: 2 * math.pi * turns * (x + sign * y**2),
    )
    phase = torch.as_tensor(kinds[rng.integers(len(kinds))]())
    return np.asarray(phase_to_grey(panel, phase, wavelength).numpy(), dtype=np.uint8)


@dataclass(frozen=True)
class _Outcome:
    """Of a scene: the errors over tol of the pictures by estimates and by bounds, and what the
    bounds tell of that; and the processor seconds of plan and picture, and of everything on."""

    words: str
    share: float
    bounded_share: float
    bound: float
    planned_seconds: float
    whole_seconds: float

    @property
    def caution(self) -> float:
        """What bounds tell over what is so; nan where nothing is left out."""
        return self.bound / self.bounded_share if self.bound and self.bounded_share else math.nan


def _outcomes() -> Iterator[_Outcome]:
    """Each scene by estimates and by bounds for a tolerance of three, against everything on.

    Each is drawn anew in a process of its own, so that neither finds ready what the other found:
    how many wavelengths and how wide a PSF are enough is found for everything on, too.
    """
    with get_context("fork").Pool(1, maxtasksperchild=1) as pool:
        for number in range(_MOST_DRAWN):
            if (orders := pool.apply(_affordable_orders, (number,))) is None:
                continue
            whole = pool.apply(_render_everything, (number, orders))
            if whole is not None:
                yield pool.apply(_render_planned, (number, orders, *whole))


def _drawn(number: int) -> Situation | None:
    return lit_situation(np.random.default_rng([_SEED, number]))


@single_threaded
def _affordable_orders(number: int) -> bool | None:
    """Whether a scene is rendered with the panel's orders; None if it is left out."""
    s = _drawn(number)
    case = None if s is None else affordable_case(number, s, _MOST_WORK)
    return None if case is None else case.orders


@single_threaded
def _render_everything(number: int, orders: bool) -> tuple[bytes, float] | None:
    """The picture as bytes, since a pool would keep tensors in this process, and the seconds."""
    s = _drawn(number)
    assert s is not None
    began = time.process_time()
    try:
        truth = everything(Case(number, s, orders), _PATIENCE)
    except TooLong:
        return None
    return pickle.dumps(truth), time.process_time() - began


@single_threaded
def _render_planned(number: int, orders: bool, picture: bytes, whole: float) -> _Outcome:
    s, truth = _drawn(number), pickle.loads(picture)
    assert s is not None
    case, tol = Case(number, s, orders), _TOLERANCES[number % 3]
    began = time.process_time()
    error, _ = deviation(case, tol, truth, "estimate")
    spent = time.process_time() - began
    bounded, plan = deviation(case, tol, truth, "bound")
    # The shape of shot noise is in neither mean nor variance, so that nothing of it is measured.
    told = sum(one.relative for one in plan.decisions if one.effect != "shot noise")
    shares = error.worst / tol, bounded.worst / tol, min(told, plan.relative_error) / tol
    return _Outcome(f"tol {tol:g}: {case.words}", *shares, spent, whole)


def lit_scenes_figures(folder: Path) -> list[Figure]:
    """Whether estimates and bounds keep tol, how careful these are, and what estimates save."""
    found = list(islice(_outcomes(), _COUNT))
    shares = [one.share for one in found]
    beyond = [f"{one.share:.1f} of {one.words}" for one in found if not one.share <= 1]
    dearer = sum(one.planned_seconds > _DEARER * one.whole_seconds for one in found)
    spent = sum(one.planned_seconds for one in found)
    whole = sum(one.whole_seconds for one in found)
    for line in beyond:
        print_message(line)
    count, far = len(shares), sum(not share <= 3 for share in shares)
    broken = sum(not one.bounded_share <= 1 for one in found)
    cautions = [one.caution for one in found if not math.isnan(one.caution)]
    caution = statistics.median(cautions) if cautions else math.inf
    return [
        Figure(
            "lit scenes, mean .05 electrons to full well, Lyot and Gaussian filters, 23 kinds of "
            "patterns, tol 1e-1 / 1e-2 / 1e-3, by estimates: beyond tol; beyond 3 tol",
            "≤ 1 %; 0",
            f"{len(beyond)}; {far} of {count}, worst {max(shares, default=math.inf):.2f} tol",
            count > 0 and len(beyond) <= 0.01 * count and not far,
        ),
        Figure(
            "the same: plan and picture dearer than everything on by more than 10 %",
            "≤ 5 %",
            f"{dearer} of {count}; all together {spent / max(whole, 1e-9):.2f} of everything on",
            count > 0 and dearer <= 0.05 * count,
        ),
        Figure(
            "the same by bounds: beyond tol; median of what plans tell over what is so",
            "0; ≤ 300",
            f"{broken} of {count}; {caution:.0f} (of {len(cautions)} that leave something out)",
            count > 0 and not broken and caution <= 300,
        ),
    ]


MEASUREMENTS = {"lit scenes": lit_scenes_figures}
