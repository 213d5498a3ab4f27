"""The choice of a restoration by the time it takes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.signal import fftconvolve
from test_plug_and_play import chambolle

from optics.accuracy import MachineSpeed
from optics.inverse.choice import METHODS, choose_method, restore
from optics.inverse.method import RestorationCase, predicted_gain
from optics.inverse.observation_builder import build_observation


@pytest.fixture(scope="module")
def blurred():
    """Disks on a ramp, seen through a box of 7 x 7: the sharp frame, and the problem."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:70, :76].astype(float)
    scene = 0.2 + 0.2 * x / 76
    for _ in range(12):
        cy, cx, r = rng.uniform(0, 70), rng.uniform(0, 76), rng.uniform(4, 18)
        scene[np.hypot(y - cy, x - cx) < r] = rng.uniform(0.1, 1)
    psf = np.full((7, 7), 1 / 49)
    frame = fftconvolve(scene, psf, "valid")
    noisy = frame + 0.01 * rng.standard_normal(frame.shape)
    return scene[3:-3, 3:-3], noisy, build_observation(noisy.astype(np.float32), psf)


def left(picture, sharp):
    return float(np.sqrt(np.mean((np.asarray(picture) - sharp) ** 2)))


@pytest.mark.parametrize("method", METHODS)
def test_every_method_undoes_some_of_the_blur(blurred, method):
    sharp, noisy, seen = blurred
    restored = restore(seen, method=method, denoise=chambolle)
    assert left(restored.image, sharp) < 0.85 * left(noisy, sharp)


def test_more_time_gives_a_method_that_gains_more(blurred):
    """By the gains that are predicted for this photograph."""
    *_, seen = blurred
    speed, case, chosen, gains = MachineSpeed(), RestorationCase.of(seen), [], []
    for budget in (0.01, 0.02, 0.05, 0.2, 1.0, 100.0):
        name, count = choose_method(seen, budget, denoise=chambolle, speed=speed)
        chosen.append(name)
        gains.append(predicted_gain(METHODS[name].gains[count], case))
        assert METHODS[name].seconds(seen, count, speed) <= budget
    assert gains == sorted(gains)
    assert chosen[0] != chosen[-1]
    assert chosen[-1] == "plug-and-play"


def test_the_choice_sees_the_case(blurred):
    """What a method gains depends on noise, PSF and border; a number is for every case."""
    *_, seen = blurred
    rough = build_observation(seen.image + 0.1 * torch.randn(seen.image.shape), seen.psf)
    wide = build_observation(seen.image, torch.full((21, 21), 1 / 441))
    cases = [RestorationCase.of(one) for one in (seen, rough, wide)]
    assert cases[1].noise > cases[0].noise
    assert cases[2].size > cases[0].size
    assert cases[0].border == 1
    assert RestorationCase.of(replace(seen, border="periodic")).border == 0
    gain = METHODS["total-variation"].gains[30]
    assert predicted_gain(gain, cases[0]) != predicted_gain(gain, cases[1])
    assert predicted_gain(4.0, cases[0]) == predicted_gain(4.0, cases[2]) == 4.0


def test_what_needs_a_denoiser_is_left_out_without_one(blurred):
    *_, seen = blurred
    assert choose_method(seen, 100.0)[0] != "plug-and-play"
    with pytest.raises(ValueError, match="no denoiser is given; give one"):
        restore(seen, method="plug-and-play")


def test_a_method_gets_the_iterations_that_fit(blurred):
    *_, seen = blurred
    counts = sorted(METHODS["total-variation"].gains)
    speed = MachineSpeed()
    price = METHODS["total-variation"].seconds(seen, counts[1], speed)
    restored = restore(seen, 1.001 * price, "total-variation", speed=speed)
    assert restored.iterations == counts[1]


def test_a_budget_for_nothing_says_what_would_do(blurred):
    *_, seen = blurred
    with pytest.raises(ValueError, match="budget is 1e-06 s; the quickest, wiener") as refused:
        restore(seen, 1e-6)
    (enough,) = re.findall(r"takes about ([\d.e-]+) s", str(refused.value))
    assert restore(seen, float(enough)).method.startswith("Wiener")


def test_a_slower_machine_is_given_less_work(blurred):
    *_, seen = blurred
    price = METHODS["total-variation"].seconds(seen, 20, MachineSpeed())
    slow = MachineSpeed(call=5e-3, fft=7e-10, touch=2e-9)
    assert restore(seen, price, "total-variation").iterations == 20
    with pytest.raises(ValueError, match="quickest"):
        restore(seen, price / 10, "total-variation", speed=slow)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"method": "magic"}, "method is 'magic'; choose one of wiener, richardson-lucy"),
        ({"budget": -1.0}, "budget"),
        ({"budget": float("nan")}, "budget"),
        ({"weight": 1e-3}, "name the method as well"),
        ({"count": 3}, "name the method as well"),
        ({"method": "wiener", "budget": 1.0, "count": 3}, "give one of them"),
        ({"method": "total-variation", "count": 0}, "count is 0; at least 1"),
    ],
)
def test_what_can_not_be_asked(blurred, asked, message):
    *_, seen = blurred
    with pytest.raises(ValueError, match=message):
        restore(seen, **asked)
