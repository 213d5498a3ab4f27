"""Bounds of the sensor's noises and stages are not much larger than what these do.

Even light on pixels that have little besides is the worst for most of them: what a stage does to
one pixel it does to all, and the norm over pixels is as large as its bound can be.
"""

import math
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.stats as st
import torch
from sensor_situations import BARE, EFFECTS, changes, read, situation

from optics.camera import Sensor
from optics.sensor.frame_sampling import electrons_from_normal
from simulator.effects.electron_bounds import can_clip, proportional_error_bound, sensor_error_bound
from simulator.effects.shot_noise import ShotNoise
from simulator.recipe import Recipe

SIDE = 40
EXPOSURE = 0.5


def pixels(gain: float = 0.5, **more) -> Sensor:
    """Any that aren't said to have it are without noise, and their wells are deep."""
    quiet = {"read_noise": 0.0, "dark_current": 0.0, "black_level": 0.0, "full_well": 1e5}
    return Sensor(shape=(SIDE, SIDE), bits=16, gain=gain, **quiet | more)


def even(electrons: float) -> torch.Tensor:
    """Electrons per second that leave so many in each pixel."""
    return torch.full((SIDE, SIDE), electrons / EXPOSURE).double()


def others(effect, s) -> Recipe:
    """With all other effects that are there; steps of the converter would hide small changes, so
    they are there for shot noise alone, and full wells count as deeper ones do."""
    recipe = BARE.with_changes(shot="Poisson")
    for one in EFFECTS:
        left_out = {"clipping"} if can_clip(s) else set()
        left_out |= set() if effect.name == "shot noise" else {"quantisation"}
        if one is not effect and one.is_present(s) and one.name not in left_out:
            recipe = one.add_to_recipe(recipe, s, len(one.levels) - 1)
    return recipe


@dataclass(frozen=True)
class Worst:
    """Even light on a sensor, and how much larger bounds of (mean, variance, sigma) may be than
    what an effect changes from a level to its finest; None: that is hardly changed there."""

    effect: str
    electrons: float
    sensor: Sensor
    slack: tuple[float | None, float | None, float | None]
    because: str
    level: int = 0

    def __str__(self) -> str:
        return f"{self.effect} {self.level} {self.slack}"


READ = pixels(read_noise=2.5, black_level=80.0)
WORST = [
    Worst("dark current", 0.5, pixels(dark_current=60.0), (1.02, 1.02, 1.3), "the same on all"),
    Worst("clipping", 3000.0, pixels(full_well=300.0), (1.05, 1.05, 1.05), "all wells are full"),
    Worst("quantisation", 2.0, pixels(8.0), (3, None, None), "half a step, which is rare"),
    Worst("quantisation", 3.9, pixels(8.0), (None, 4, 3), "half a step; two standard deviations"),
    Worst("read noise", 0.5, READ, (None, 1.5, 2.0), "a step of the converter's besides"),
    Worst("read noise", 0.5, pixels(read_noise=2.5), (2.5, None, None), "half of it is below 0"),
    Worst("shot noise", 11.0, pixels(2.0), (2.5, None, None), "half a step at once"),
    Worst("shot noise", 3000.0, pixels(), (None, 1.05, 1.05), "the number's variance is its mean"),
    Worst("shot noise", 11.0, pixels(8.0), (9, 17, 45), "steps that wouldn't meet", 1),
    Worst("fixed pattern", 100.0, pixels(dsnu=20.0), (1.4, None, None), "5 deviations of the sum"),
    Worst("fixed pattern", 2.0, pixels(dsnu=5.0, read_noise=1.0), (2, 8, 8), "all are cut at 0"),
    Worst("fixed pattern", 1e4, pixels(prnu=0.02), (6, 6, 45), "all 4.5 deviations off"),
    Worst("fixed pattern", 0.1, pixels(hot=0.05, hot_current=1e4), (1.5, 1.5, 4), "all are known"),
    Worst("fixed pattern", 1e4, pixels(dead=0.05), (1.5, 1.5, 4), "all are known"),
]  # fmt: skip


@pytest.mark.parametrize("one", WORST, ids=str)
def test_a_bound_is_near_what_its_effect_changes(one: Worst):
    s = situation(even(one.electrons), one.sensor, EXPOSURE)
    effect = next(effect for effect in EFFECTS if effect.name == one.effect)
    recipe = others(effect, s)
    if effect.name == "shot noise" and not one.level:
        recipe = recipe.with_changes(shot="none")
    fine, coarse = (
        effect.add_to_recipe(recipe, s, level) if level else recipe
        for level in (len(effect.levels) - 1, one.level)
    )
    light, bound = even(one.electrons), effect.error_bound(s, one.level)
    found = changes(*(read(light, one.sensor, EXPOSURE, each) for each in (coarse, fine)))
    for measured, most, slack in zip(
        found, (bound.mean, bound.variance, bound.sigma), one.slack, strict=True
    ):
        if slack is not None:
            assert measured * (1 - 1e-5) <= most <= slack * measured, one.because


def test_every_effect_has_its_worst():
    assert {one.effect for one in WORST} == {effect.name for effect in EFFECTS}


def test_rounding_moves_a_quiet_number_by_half_a_step_at_most():
    """3.999 electrons without any noise are 0 in steps of 8."""
    sensor, light = pixels(8.0), even(3.999)
    rounded, exact = (read(light, sensor, EXPOSURE, one)
                      for one in (BARE.with_changes(quantisation=True), BARE))  # fmt: skip
    moved = changes(rounded, exact)[0]
    effect = next(effect for effect in EFFECTS if effect.name == "quantisation")
    assert moved == pytest.approx(3.999 * SIDE)
    assert moved <= effect.error_bound(situation(light, sensor, EXPOSURE), 0).mean <= 1.001 * moved


@pytest.mark.parametrize(("level", "shot"), [(1, "Gaussian"), (2, "skewed")])
def test_a_distributions_distance_is_near_its_bound_at_ten_electrons(level, shot):
    """Where a normal distribution may take over; what it is by scipy."""
    electrons, count = 10.0, 40
    numbers = np.arange(count)
    exact = st.poisson.cdf(numbers, electrons)
    noise = torch.from_numpy(st.norm.ppf((np.arange(10**6) + 0.5) / 10**6))
    drawn = (
        electrons_from_normal(torch.full((10**6,), electrons).double(), noise, shot).round().long()
    )
    seen = torch.bincount(drawn.clamp(min=0), minlength=count).double().cumsum(0)[:count] / 10**6
    distance = np.abs(seen.numpy() - exact).max()
    s = situation(even(electrons), pixels(), EXPOSURE)
    assert distance <= ShotNoise().error_bound(s, level).shape <= 1.5 * distance
    assert ShotNoise().error_bound(s, 0).shape == 1
    assert ShotNoise().error_bound(s, 3).shape == 0


def test_less_light_changes_about_what_is_told():
    """A tenth of even light: of n electrons, 0.1 n in mean and variance, √n (1 - √0.9) in σ; the
    dimmest pixels count as half as bright as they are."""
    n, pixels_ = 400.0, SIDE
    s = situation(even(n), pixels(read_noise=1.0, black_level=80.0), EXPOSURE)
    lost = 0.1 * n * pixels_
    bound = sensor_error_bound(s, lost, "proved: so")
    assert lost <= bound.mean <= 1.02 * lost
    assert lost <= bound.variance <= 1.1 * lost
    sigma = math.sqrt(n) * (1 - math.sqrt(0.9)) * pixels_
    assert sigma <= bound.sigma <= 1.1 * math.sqrt(2) * sigma


def test_light_that_is_lost_in_proportion_changes_little_where_it_is_dark():
    """Half of the picture is dark. There σ would change most of all if light came from elsewhere;
    a share of its own light is no more of σ than in the bright half, ε √n / 2."""
    n, share = 400.0, 0.1
    light = even(n)
    light[:, : SIDE // 2] = 0.0
    s = situation(light, pixels(read_noise=0.3, black_level=80.0), EXPOSURE)
    lost = share * n * SIDE / math.sqrt(2)
    told, anywhere = proportional_error_bound(s, lost, "so"), sensor_error_bound(s, lost, "so")
    sigma = math.sqrt(n) * (1 - math.sqrt(1 - share)) * SIDE / math.sqrt(2)
    assert sigma <= told.sigma <= 5 * sigma < anywhere.sigma
    assert told.mean == anywhere.mean
    assert told.variance == anywhere.variance
