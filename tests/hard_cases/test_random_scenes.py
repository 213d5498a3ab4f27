"""Scenes and benches by chance: every picture by a plan is within its tolerance of everything on.

Twelve draws, the quicker ones by default, of the two hundred that `make figures ONLY=effects`
takes, from another seed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from figures.effects import audited, judged, swept_by
from figures.random_pictures import Case, TooLong, cases, everything, random_situation

from labapp.prediction.simulating.all_effects import Deviation
from simulator.effects.registry import EFFECTS
from simulator.imaging import PictureMoments

SEED, COUNT, MOST_WORK = 7, 12, 6e8


@cache
def draws() -> Iterator[Case]:
    return cases(SEED, MOST_WORK)


@cache
def drawn(number: int) -> Case:
    """One after the other: each takes a plan to see what it costs."""
    if number:
        drawn(number - 1)
    return next(draws())


def numbers(quick: Collection[int], every: Iterable[int]) -> list[Any]:
    sweep = pytest.mark.sweep
    return [number if number in quick else pytest.param(number, marks=sweep) for number in every]


@pytest.mark.parametrize("number", numbers((4, 6), range(COUNT)))
def test_a_plans_picture_is_within_its_tolerance_of_everything_on(number: int) -> None:
    truth = list(judged([drawn(number)]))
    for found in swept_by(truth, ("bound", "estimate")):
        assert found.count == 1
        assert not found.wrong, "\n".join(found.wrong)


@pytest.mark.parametrize("number", numbers((3, 6), range(0, COUNT, 3)))
def test_no_bound_of_what_is_left_out_is_broken(number: int) -> None:
    """And none of an estimate is exceeded by more than a half of it: estimates aren't limits."""
    case = drawn(number)
    estimates = audited(case, 1e-1, 3, SEED, "estimate")
    assert max((one.measured_over_bound for one in estimates), default=0.0) <= 1.5, case.words
    broken = [one for one in audited(case, 1e-1, 3, SEED) if one.is_broken]
    assert not broken, case.words


@pytest.mark.parametrize("number", [293, 1132])
def test_a_target_that_moved_beside_the_frame_leaves_no_light_there(number: int) -> None:
    probe = random_situation(np.random.default_rng([SEED, number])).picture_probe
    assert 0 <= probe.total < 1e-6 * probe.brightest


def test_the_same_seed_draws_the_same_picture() -> None:
    first, second = (random_situation(np.random.default_rng([SEED, 3])) for _ in range(2))
    assert first.camera.lens == second.camera.lens
    assert first.camera.sensor == second.camera.sensor
    assert first.band == second.band
    assert first.panel_content.names == second.panel_content.names
    assert first.exposure == second.exposure
    assert first.target.radiance == second.target.radiance


def test_draws_have_every_effect_somewhere_and_miss_nearly_every_one_elsewhere() -> None:
    """Of 60 draws: what is always or never there would leave pairs untried."""
    draws = [random_situation(np.random.default_rng([SEED, k])) for k in range(60)]
    kinds = {type(s.target).__name__ for s in draws}
    assert {"Star", "Flat", "PhotographPrint", "Sheets", "Relief", "Display", "Cube"} <= kinds
    data = {
        "a video": [s.panel_content.is_changing for s in draws],
        "motion": [s.target.is_moving for s in draws],
        "a lamp": [s.target.lamp is not None for s in draws],
        "a mosaic": [s.camera.sensor.colour is not None for s in draws],
        "rolling": [s.camera.sensor.shutter == "rolling" for s in draws],
        "a leak": [s.band.leak > 0 for s in draws],
        "a turned panel": [not s.mount.is_aligned for s in draws],
        "a path": [s.path is not None for s in draws],
        "separation": [s.camera.separation > 0 for s in draws],
        "aberrations": [bool(s.camera.lens.aberrations) for s in draws],
        "coupling": [s.camera.panel.coupling > 0 for s in draws],
        "flatness": [s.camera.panel.flatness is not None for s in draws],
        "response": [s.camera.panel.response is not None for s in draws],
        "a slow crystal": [s.camera.panel.response_time > 0 for s in draws],
        "unmodulated": [s.camera.panel.unmodulated > 0 for s in draws],
        "glare": [s.camera.glare > 0 for s in draws],
        "prnu": [s.camera.sensor.prnu > 0 for s in draws],
    }
    for name, there in data.items():
        assert any(there), name
        assert not all(there), name


def test_every_effect_of_the_registry_is_caused_by_some_draw() -> None:
    missing = list(EFFECTS)
    for k in range(60):
        s = random_situation(np.random.default_rng([SEED, k]))
        missing = [one for one in missing if not one.is_present(s)]
    assert not [one.name for one in missing]


def test_a_deviation_is_relative_and_by_the_root_of_the_variance() -> None:
    ones = torch.ones(4, 4)
    truth = PictureMoments(ones, 2 * ones, 4 * ones)
    off = PictureMoments(ones, 2.2 * ones, 9 * ones)
    found = Deviation.of(off, truth)
    assert found.mean == pytest.approx(0.1)
    assert found.variance == pytest.approx(1.25)
    assert found.sigma == pytest.approx(0.5)
    assert found.worst == found.variance
    dark = PictureMoments(0 * ones, 0 * ones, 0 * ones)
    assert Deviation.of(dark, dark).worst == 0
    assert Deviation.of(truth, dark).worst == 1


def test_a_picture_that_takes_too_long_is_given_up() -> None:
    with pytest.raises(TooLong, match=f"draw {drawn(0).number}"):
        everything(drawn(0), patience=0.0)
