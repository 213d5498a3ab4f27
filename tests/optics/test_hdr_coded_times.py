"""Times and motion of 8-bit brackets whose curve, light and faults are known."""

import math

import numpy as np
import pytest

from optics.hdr import (
    MOVED,
    check_coded_times,
    find_motions,
    fit_response,
    is_nominal,
    merge_by_response,
    shutter_time,
)

TIMES = np.array([1.0, 3.0, 9.0, 27.0]) / 100
SHAPE = (160, 200)


def light(seed=1):
    """Even patches of a decade and a half, with soft edges."""
    rng = np.random.default_rng(seed)
    patches = np.kron(rng.uniform(-0.6, 1.1, (16, 20)), np.ones((10, 10)))
    patches = (patches + np.roll(patches, 1, 0) + np.roll(patches, 1, 1)) / 3
    return 10**patches


def frames(times, curve=lambda share: share ** (1 / 2.2), scene=None, seed=1):
    rng = np.random.default_rng(seed)
    scene = light() if scene is None else scene
    found = []
    for time in times:
        share = np.clip(scene * time / 0.5 + rng.normal(0, 0.002, SHAPE), 0, 1)
        found.append([np.clip(np.rint(255 * curve(share)), 0, 255).astype(np.uint8)])
    return found


def s_shaped(share):
    coded = share ** (1 / 2.2)
    return coded**2 * (3 - 2 * coded)


@pytest.mark.parametrize("curve", [lambda share: share ** (1 / 2.2), s_shaped])
@pytest.mark.parametrize("wrong", [1, 2])
@pytest.mark.parametrize("factor", [0.75, 1.1])
def test_the_one_wrong_time_of_four_is_named_and_measured(curve, wrong, factor):
    true = TIMES.copy()
    true[wrong] *= factor
    found = check_coded_times(frames(true, curve), TIMES)
    assert found.suspects == (wrong,)
    assert found.corrections[wrong] == pytest.approx(factor, rel=0.02)
    assert found.explain()[0].startswith(f"frame {wrong + 1} has {found.factors[wrong]:.3g} times")


@pytest.mark.parametrize("curve", [lambda share: share ** (1 / 1.7), s_shaped])
def test_right_times_are_not_named_whatever_the_curve(curve):
    found = check_coded_times(frames(TIMES, curve), TIMES)
    assert found.suspects == ()
    assert found.explain() == []
    assert (found.corrections == 1).all()
    # A curve's power and that of all times are one: nobody can tell them apart.
    assert check_coded_times(frames(TIMES, curve), TIMES**1.3).suspects == ()


def test_of_three_frames_nobody_knows_which_time_is_wrong_and_two_tell_nothing():
    found = check_coded_times(frames(TIMES[:3] * [1, 1.3, 1]), TIMES[:3])
    assert found.suspects == (0, 1, 2)
    assert (found.corrections == 1).all()
    assert "don't tell which" in found.explain()[0]
    # The middle one alone: 1.3. An end alone: the same ratio of both steps' logarithms.
    step = math.log(3)
    power = step / (step - math.log(1.3))
    assert found.factors[1] == pytest.approx(1.3, rel=0.02)
    assert math.log(found.factors[2]) == pytest.approx(
        step / (power * (step + math.log(1.3)) / step) - step, abs=0.06
    )
    two = check_coded_times(frames(TIMES[:2] * [1, 1.3]), TIMES[:2])
    assert two.suspects == ()


def test_the_rounding_of_cameras_is_no_wrong_time():
    """1/60 s stands for 1/64 s: the steps are those of 2^(1/3), by definition of the series."""
    true = np.array([1 / 512, 1 / 64, 1 / 16, 1 / 2])
    told = np.array([1 / 500, 1 / 60, 1 / 15, 1 / 2])
    for nominal, meant in ((1 / 500, 1 / 512), (1 / 60, 1 / 64), (30.0, 32.0), (0.5, 0.5)):
        assert shutter_time(nominal) == pytest.approx(meant)
    assert not is_nominal(0.0171)
    assert shutter_time(0.0171) == 0.0171
    scene = light() * 0.25
    assert check_coded_times(frames(true, scene=scene), told).suspects == ()


def test_the_frame_that_moved_is_found_among_those_that_stand_still():
    scene = light()
    every = frames(TIMES)
    # Whole pixels need no interpolation: what is seen at x + (3, -2).
    every[2] = frames(TIMES, scene=np.roll(scene, (3, -2), (0, 1)))[2]
    found = find_motions((one, [band > 250 for band in one]) for one in every)
    assert found.moved == [2]
    motion = found.motions[2]
    assert (motion.down, motion.right) == pytest.approx((3, -2), abs=0.05)
    assert max(found.distances[k] for k in (0, 1, 3)) < 0.1


def test_what_moved_within_the_picture_is_left_out():
    rise = np.linspace(-0.9, 1.1, SHAPE[0])[:, None]
    scene = 10 ** (rise + 0.2 * np.sin(np.arange(SHAPE[1]) / 9))
    every = frames(TIMES, scene=scene)
    moved = scene.copy()
    moved[40:70, 50:90] = 6.0
    every[1] = frames(TIMES, scene=moved)[1]
    bands = [one[0] for one in every]
    merged = merge_by_response(bands, TIMES, fit_response(bands, TIMES))
    state, rate = merged.state.numpy(), merged.rate.numpy()
    differs = np.abs(np.log(moved / scene)) > 1
    assert (state[differs] == MOVED).mean() > 0.9
    assert (state[~differs] == MOVED).mean() < 0.02
    still = ~differs & (state == 0)
    unit = np.median((rate / scene)[still])
    # The curve itself is known to some percent.
    assert np.median(np.abs(np.log(rate / scene / unit))[differs]) < 0.06


def test_pixels_that_a_frame_does_not_show_are_told_by_the_others():
    bands = [one[0] for one in frames(TIMES)]
    curve = fit_response(bands, TIMES)
    absent = [np.zeros(SHAPE, dtype=bool) for _ in bands]
    absent[1][:20] = True
    whole = merge_by_response(bands, TIMES, curve)
    spoilt = [one.copy() for one in bands]
    spoilt[1][:20] = 200
    partly = merge_by_response(spoilt, TIMES, curve, outside=absent)
    assert np.array_equal(partly.rate[20:], whole.rate[20:])
    ratio = (partly.rate[:20] / whole.rate[:20]).numpy()
    assert np.median(np.abs(ratio - 1)) < 0.03
    assert (partly.variance[:20] >= whole.variance[:20] * 0.99).float().mean() > 0.9


def test_large_frames_are_averaged_down_and_their_motion_is_in_their_own_pixels(monkeypatch):
    monkeypatch.setattr("optics.hdr.frame_motion._MOST", SHAPE[0] * SHAPE[1] // 3)
    every = frames(TIMES[:2])
    every[1] = frames(TIMES, scene=np.roll(light(), (4, -2), (0, 1)))[1]
    found = find_motions((one, [band > 250 for band in one]) for one in every)
    away = found.motions[1 - found.reference]
    sign = 1 if found.reference == 0 else -1
    assert found.shape == SHAPE
    assert (sign * away.down, sign * away.right) == pytest.approx((4, -2), abs=0.15)
