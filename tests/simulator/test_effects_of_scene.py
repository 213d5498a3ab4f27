"""Bounds of what follows from the target alone, against pictures summed up the long way."""

import itertools

import numpy as np
import pytest
from scene_situations import (
    LAMPS,
    PITCH,
    PLANE,
    SIDE,
    at,
    at_depths,
    blurred,
    camera,
    frame,
    moving,
    psf,
    random_pattern,
    seen_and_transparent,
    sheets,
    situation,
)
from sweeps import some

from optics.light import Waveform
from simulator.effects.depths import DepthLayers, Occlusion
from simulator.effects.time_effects import LampFlicker, Motion
from simulator.scene import Flat, Sheet, Sheets, Star
from simulator.scene.polygons import Polygons, rectangle


def holds(effect, s, level, measured):
    """A bound is never below what was measured."""
    bound = effect.error_bound(s, level)
    assert bound.mean >= measured * (1 - 1e-5)
    return bound.mean


def falls(effect, s):
    """No level's bound is above a coarser one's, the finest's is nothing."""
    bounds = [effect.error_bound(s, level).mean for level in range(effect.finest_level(s) + 1)]
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[-1] == 0
    assert all(effect.explain(s))
    assert all(effect.estimated_error(s, k) >= 0 for k in range(effect.finest_level(s) + 1))


@pytest.mark.parametrize("seed", range(8))
def test_depth_layers(seed):
    rng = np.random.default_rng(seed)
    s = situation(sheets(rng, int(rng.integers(2, 5))))
    effect, pattern = DepthLayers(), random_pattern(rng)
    assert effect.is_present(s)

    exact = at_depths(s, pattern, 33)
    for level in range(effect.finest_level(s)):
        measured = np.linalg.norm(at_depths(s, pattern, int(effect.levels[level])) - exact)
        holds(effect, s, level, measured)
    falls(effect, s)


@pytest.mark.parametrize("seed", range(8))
def test_occlusion(seed):
    rng = np.random.default_rng(100 + seed)
    pattern = random_pattern(rng)
    target = sheets(rng, int(rng.integers(2, 4)), background=bool(rng.integers(2)))
    spreads = [psf(layer.distance, pattern) for layer in target.layers]

    def reach(share):
        """By counting: the smallest square that leaves out less than the share of any PSF."""
        away = np.abs(np.arange(PLANE) - PLANE // 2)
        square = np.maximum(away[:, None], away)
        sums = [np.bincount(square.ravel(), one.ravel()) for one in spreads]
        worst = np.max([1 - np.cumsum(one) for one in sums], axis=0)
        return float(np.argmax(worst <= share) + 1) * PITCH

    s = situation(target, reach=reach)
    effect = Occlusion()
    if not effect.is_present(s):
        return
    seen, transparent = seen_and_transparent(s, spreads)
    measured = np.linalg.norm(transparent - seen)
    bound = holds(effect, s, 0, measured)
    # It is of use: no more than all the light that is behind.
    behind = sum(float(one.double().norm()) for one in s.picture_probe.lights[1:])
    assert bound <= behind * s.exposure * 1.02
    falls(effect, s)


def test_occlusion_of_things_far_apart_is_nothing_much():
    """Two small sharp things on either side of the frame; a PSF of two pixels."""
    left = Polygons((rectangle((0.0, -9e-4), (3e-4, 3e-4)),), (1.0,))
    right = Polygons((rectangle((0.0, 1.2e-3), (3e-4, 3e-4)),), (1.0,))
    target = Sheets((Sheet(1.9, ((None, left),), left), Sheet(2.1, ((None, right),), right)), 1e8)
    s = situation(target, reach=lambda share: 2 * PITCH)
    bound = Occlusion().error_bound(s, 0).mean
    assert bound <= 3e-4 * float(s.picture_probe.lights[1].double().norm()) * s.exposure
    assert Occlusion().estimated_error(s, 0) == 0


@pytest.mark.parametrize("lamp", LAMPS)
@pytest.mark.parametrize("exposure", [3e-4, 7.3e-3, 0.05])
def test_lamp_flicker_of_rows(lamp, exposure):
    """Each row sees the lamp's mean over its own exposure: summed up over many instants."""
    cam = camera(shutter="rolling", line_time=3e-5)
    s = situation(Flat(2.0, 1e8, lamp=lamp), cam, exposure=exposure, moment=0.123)
    light = frame(s.picture_probe.sharp_picture.double().numpy())
    instants = (np.arange(20_000) + 0.5) / 20_000 * exposure
    seen = np.array([lamp.at(0.123 + 3e-5 * row + instants).mean() for row in range(SIDE)])
    for rows in (seen, np.full(SIDE, seen[0])):
        measured = np.linalg.norm(light * (rows - 1)[:, None]) * exposure
        holds(LampFlicker(), s, 0, measured * (1 - 1e-3))
    falls(LampFlicker(), s)


@pytest.mark.parametrize("seed", range(6))
def test_lamp_flicker_of_a_video(seed):
    """Frames of 1/60 s, each with a PSF of its own, under a lamp that favours some of them."""
    rng = np.random.default_rng(seed)
    lamp = LAMPS[seed % 3]
    exposure = float(10 ** rng.uniform(-3, -1))
    target = Star(1e-3, 2.0, 1e8, lamp=lamp)
    s = situation(target, exposure=exposure, moment=float(rng.uniform(0, 1)), moves=True)
    spreads = [psf(2.0, random_pattern(rng)) for _ in range(2)]
    pictures = [frame(blurred(s.picture_probe.lights[0], one)) for one in spreads]
    times = s.exposure_start + (np.arange(20_000) + 0.5) / 20_000 * exposure
    first = np.floor(times * 60).astype(int) % 2
    lit = lamp.at(times) - 1
    shares = [(lit * (first == k)).mean() * exposure for k in range(2)]
    change = shares[0] * pictures[0] + shares[1] * pictures[1]
    holds(LampFlicker(), s, 0, np.linalg.norm(change) * (1 - 1e-3))
    falls(LampFlicker(), s)


def test_a_steady_lamp_causes_nothing():
    assert not LampFlicker().is_present(situation(Flat(2.0, 1e8)))
    assert not LampFlicker().is_present(situation(Flat(2.0, 1e8, lamp=Waveform())))
    assert not Motion().is_present(situation(Flat(2.0, 1e8)))
    assert not DepthLayers().is_present(situation(Flat(2.0, 1e8)))
    assert not Occlusion().is_present(situation(Flat(2.0, 1e8)))


@pytest.mark.parametrize(
    ("seed", "rolling"), some(itertools.product(range(8), [False, True]), 0, 7, 11, 14)
)
def test_motion(seed, rolling):
    """By very many instants, each with its own place, lamp and PSF; rows in turn where rolling."""
    rng = np.random.default_rng(seed)
    lamp = LAMPS[seed % 3] if seed % 2 else None
    video = seed >= 6
    cam = camera(shutter="rolling", line_time=4e-5) if rolling else camera()
    exposure = 4e-3
    s = situation(moving(rng, lamp), cam, exposure=exposure, moment=0.0, moves=video)
    spreads = [psf(2.0, random_pattern(rng)) for _ in range(2 if video else 1)]
    starts = 4e-5 * np.arange(SIDE) if rolling else np.zeros(SIDE)
    whole = exposure + starts[-1]

    def frames(time):
        return int(time // 1e-3) % len(spreads)

    def summed(count, path):
        """Of instants; path(time) is the place where it counts as being."""
        total = np.zeros((SIDE, SIDE))
        step = whole / count
        cached = {}
        for k in range(count):
            time = (k + 0.5) * step
            rows = (starts <= time) & (time < starts + exposure)
            weight = step * (lamp.at(time) if lamp else 1.0)
            place = path(time)
            key = (round(place, 9), frames(time))
            if key not in cached:
                cached = {key: frame(blurred(at(s, place), spreads[key[1]]))}
            total += cached[key] * weight * rows[:, None]
        return total

    count = 96
    exact = summed(count, lambda time: time)
    effect = Motion()
    measured = np.linalg.norm(summed(count, lambda time: exposure / 2) - exact)
    holds(effect, s, 0, measured * 0.99)
    falls(effect, s)


def test_a_path_in_parts_is_nearer_the_finer_they_are():
    """Under a lamp that flickers, each part lit evenly by its own mean light."""
    rng = np.random.default_rng(5)
    lamp = LAMPS[1]
    s = situation(moving(rng, lamp), exposure=4e-3)
    spread = psf(2.0, random_pattern(rng))
    count = 128
    times = (np.arange(count) + 0.5) / count * 4e-3
    pictures = np.array([frame(blurred(at(s, time), spread)) for time in times])
    weights = lamp.at(times)
    exact = np.tensordot(weights, pictures, 1) * 4e-3 / count
    for level in range(1, 5):
        means = np.repeat(weights.reshape(2**level, -1).mean(1), count // 2**level)
        measured = np.linalg.norm(np.tensordot(means, pictures, 1) * 4e-3 / count - exact)
        holds(Motion(), s, level, measured)


def test_an_even_path_is_exact_in_one_piece():
    s = situation(moving(np.random.default_rng(1)))
    assert Motion().finest_level(s) == 1
    assert Motion().error_bound(s, 1).mean == 0


def test_work_grows_with_the_level():
    s = situation(sheets(np.random.default_rng(0), 4), reach=lambda share: 2 * PITCH)
    for effect in (DepthLayers(), Occlusion()):
        done = [
            effect.added_operations(s, {effect.name: k}) for k in range(effect.finest_level(s) + 1)
        ]
        assert done == sorted(done)
        assert done[0] == 0
    s = situation(moving(np.random.default_rng(1), LAMPS[0]))
    for effect in (Motion(), LampFlicker()):
        done = [
            effect.added_operations(s, {effect.name: k}) for k in range(effect.finest_level(s) + 1)
        ]
        assert done == sorted(done)
        assert done[0] == 0


def test_recipes_have_what_effects_add():
    class Kept:
        def with_changes(self, **changes):
            return changes

    assert LampFlicker().add_to_recipe(Kept(), None, 1) == {"lamp": True}
    assert Motion().add_to_recipe(Kept(), None, 3) == {"motion": 8}
    assert DepthLayers().add_to_recipe(Kept(), None, 4) == {"depths": 9}
    assert Occlusion().add_to_recipe(Kept(), None, 1) == {"occlusion": True}
