"""Bounds of the sensor's noises and stages against what they do, on any sensor and picture.

Every effect is switched by itself while the others are on or off by chance; what mean, variance
and σ change is the difference of exact moments.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats as st
import torch
from sensor_situations import BARE, EFFECTS, UNEVEN, changes, picture, read, sensor, situation
from sweeps import some

from optics.camera import Sensor
from optics.sensor.frame_sampling import electrons_from_normal
from simulator.effects.electron_bounds import can_clip, sensor_error_bound
from simulator.effects.sensor_effects import (
    Clipping,
    DarkCurrent,
    FixedPattern,
    Quantisation,
    ReadNoise,
)
from simulator.effects.shot_noise import ShotNoise

STEEPER = (113, 149, 220, 233)
"""Where wells that are full by the sensor's table aren't by what counts, or Poisson's
distribution meets a normal one."""


def around(rng, effect, s):
    """A recipe of the other effects, each on or off by chance; but no plan does without shot
    noise, for its shape is another altogether, and what is left out last is there. Of wells that
    may be full, changes count as they are before anything is clipped."""
    recipe = BARE
    for other in EFFECTS:
        if isinstance(other, Clipping) and can_clip(s):
            continue
        chance = 1.0 if isinstance(other, ShotNoise) or other.assumed_by_other_bounds else 0.7
        if other is not effect and other.is_present(s) and rng.random() < chance:
            recipe = other.add_to_recipe(recipe, s, int(rng.integers(1, len(other.levels))))
    return recipe


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda one: one.name)
@pytest.mark.parametrize(
    "seed",
    [
        *(*range(15), *STEEPER),
        *(pytest.param(seed, marks=pytest.mark.sweep) for seed in range(15, 60)),
    ],
)
def test_no_bound_is_ever_broken(effect, seed):
    rng = np.random.default_rng(seed)
    one = sensor(rng, **(UNEVEN if seed % 3 == 0 else {}))
    light = picture(rng, float(np.exp(rng.uniform(0, np.log(4 * one.full_well)))))
    s = situation(light, one)
    if not effect.is_present(s):
        return
    recipe = around(rng, effect, s)
    finest = read(light, one, 0.5, effect.add_to_recipe(recipe, s, len(effect.levels) - 1))
    before = (math.inf,) * 4
    for level in range(len(effect.levels)):
        coarse = effect.add_to_recipe(recipe, s, level) if level else recipe
        bound = effect.error_bound(s, level)
        allowed = (bound.mean, bound.variance, bound.sigma, bound.shape)
        for measured, most in zip(changes(read(light, one, 0.5, coarse), finest), allowed,
                                  strict=False):  # fmt: skip
            assert measured <= most * (1 + 1e-6) + 2e-4 * math.sqrt(144)
        assert all(now <= was for now, was in zip(allowed, before, strict=True))
        before = allowed
    assert before == (0, 0, 0, 0)


@pytest.mark.parametrize("seed", some(range(40), *range(0, 40, 2)))
def test_less_light_changes_no_more_than_is_told(seed):
    """What any optical effect is turned into: some other picture, no brighter anywhere."""
    rng = np.random.default_rng(1000 + seed)
    one = sensor(rng)
    light = picture(rng, float(np.exp(rng.uniform(0, np.log(4 * one.full_well)))))
    s = situation(light, one)
    recipe = ReadNoise().add_to_recipe(around(rng, None, s), s, 1)
    less = light * torch.from_numpy(rng.uniform(0.5, 1, light.shape))
    norm = float(torch.linalg.vector_norm((light - less) * 0.5))
    bound = sensor_error_bound(s, norm, "proved: so")
    found = changes(read(light, one, 0.5, recipe), read(less, one, 0.5, recipe))
    for measured, most in zip(found, (bound.mean, bound.variance, bound.sigma), strict=True):
        assert measured <= most * (1 + 1e-4) + 2e-4 * math.sqrt(144)


@pytest.mark.parametrize("electrons", [10.0, 10.7, 35.0, 60.0, 700.0, 6000.0])
def test_the_distance_from_poissons_distribution_is_below_its_bound(electrons):
    """Cumulative, at every whole number, by scipy; bent numbers by their quantiles."""
    s = situation(torch.full((12, 12), 2 * electrons), Sensor(shape=(12, 12)))
    counts = np.arange(int(electrons + 12 * math.sqrt(electrons)))
    spread = electrons / math.sqrt(electrons + 1 / 12)
    normal = st.norm.cdf(counts + 0.5, electrons, spread)
    distance = np.abs(normal - st.poisson.cdf(counts, electrons)).max()
    assert 0.8 * 0.068 / math.sqrt(electrons) <= distance <= ShotNoise().error_bound(s, 1).shape
    noise = torch.from_numpy(st.norm.ppf((np.arange(10**6) + 0.5) / 10**6))
    bent = electrons_from_normal(torch.full((10**6,), electrons).double(), noise, "skewed").long()
    seen = torch.bincount(bent, minlength=len(counts)).double().cumsum(0)[: len(counts)] / 10**6
    distance = np.abs(seen.numpy() - st.poisson.cdf(counts, electrons)).max()
    assert distance <= ShotNoise().error_bound(s, 2).shape


def test_a_bright_picture_calls_for_no_clipping_only_far_from_the_well():
    one = Sensor(shape=(12, 12), full_well=10_000.0)
    far, near = (situation(torch.full((12, 12), 2 * level), one) for level in (8000.0, 9700.0))
    assert Clipping().error_bound(far, 0).mean == 0
    assert Clipping().error_bound(near, 0).variance > 0


def test_where_a_picture_may_clip_its_plan_says_that_errors_count_before():
    one = Sensor(shape=(12, 12), full_well=10_000.0)
    dim, burnt = (situation(torch.full((12, 12), 2 * level), one) for level in (5000.0, 12000.0))
    said = "errors are those of the picture before it is clipped"
    assert said not in Clipping().explain(dim)
    assert said in Clipping().explain(burnt)


def test_a_lamp_that_flickers_is_as_bright_as_its_brightest_moment():
    from types import SimpleNamespace

    one = replace(Sensor(shape=(12, 12)), full_well=10_000.0)
    lamp = SimpleNamespace(ripple=0.5)
    s = situation(torch.full((12, 12), 14_000.0), one,
                  target=SimpleNamespace(
                      speckle=None, lamp=lamp, is_moving=False, layers=()))  # fmt: skip
    assert Clipping().error_bound(s, 0).mean > 0


def test_what_isnt_there_is_in_no_plan():
    plain = situation(torch.zeros(12, 12), Sensor(shape=(12, 12), dark_current=0.0, read_noise=0.0))
    there = [one.name for one in EFFECTS if one.is_present(plain)]
    assert there == ["clipping", "quantisation"]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda one: one.name)
def test_effects_say_what_they_are(effect):
    s = situation(torch.full((12, 12), 500.0), replace(Sensor(shape=(12, 12)), **UNEVEN))
    assert effect.explain(s)
    assert effect.physics
    assert effect.source
    works = [
        effect.added_operations(s, {effect.name: level}) for level in range(len(effect.levels))
    ]
    assert works[0] == 0
    assert works == sorted(works)
    assert effect.estimated_error(s, len(effect.levels) - 1) == 0


ADDED = {
    "dark current": {"dark_current": True},
    "shot noise": {"shot": "Gaussian"},
    "clipping": {"clipping": True},
    "read noise": {"read_noise": True},
    "fixed pattern": {"fixed_pattern": True},
    "quantisation": {"quantisation": True},
}


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda one: one.name)
def test_an_effect_adds_its_stage_and_no_other(effect):
    assert effect.add_to_recipe(BARE, None, 1) == BARE.with_changes(**ADDED[effect.name])


def test_what_comes_by_chance_or_follows_from_it_is_done_for_each_frame():
    each = {one.name for one in EFFECTS if one.is_per_frame}
    assert each == {"shot noise", "clipping", "read noise", "quantisation"}


def test_estimates_are_shares_of_the_variance():
    """Of 400 electrons, read with 10 and in steps of 12: 400 + 100 + 12 electrons²; of 4000 in a
    well of 3000, the fourth that is lost."""
    one = Sensor(shape=(12, 12), full_well=3000.0, gain=12.0, read_noise=10.0, dark_current=32.0)
    s = situation(torch.full((12, 12), 800.0), one)
    assert Quantisation().estimated_error(s, 0) == pytest.approx(12 / 512)
    assert ReadNoise().estimated_error(s, 0) == pytest.approx(100 / 500)
    assert DarkCurrent().estimated_error(s, 0) == pytest.approx(math.sqrt(16 / (100 + 144)))
    # Of what may come from elsewhere, a tenth more, and dark current.
    full = situation(torch.full((12, 12), 8000.0), replace(one, dark_current=0.0))
    assert Clipping().estimated_error(full, 0) == pytest.approx(0.25, abs=0.1)
    uneven = replace(one, prnu=0.02, dead=0.01)
    assert FixedPattern().estimated_error(situation(torch.ones(12, 12), uneven), 0) == 0.03
    assert all(effect.estimated_error(s, len(effect.levels) - 1) == 0 for effect in EFFECTS)
