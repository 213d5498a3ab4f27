"""Registration of pictures of a scene whose light is known between its pixels, in closed form."""

import numpy as np
import pytest
from sweeps import some

from optics.measuring import RigidMotion, register_pictures, resample_moved

SHAPE = (120, 150)
MOTION = RigidMotion(np.deg2rad(0.8), 2.3, -3.6)


def scene(at):
    """Waves of periods of 7 pixels and more, at any place (2, places)."""
    rng = np.random.default_rng(5)
    light = np.zeros(at.shape[1])
    for _ in range(60):
        way, period = rng.uniform(0, np.pi), rng.uniform(7, 60)
        wave = 2 * np.pi / period * (at[0] * np.sin(way) + at[1] * np.cos(way))
        light += period**0.5 * np.sin(wave + rng.uniform(0, 6.3))
    return light


def places():
    middle = (np.array(SHAPE)[:, None] - 1) / 2
    return np.indices(SHAPE).reshape(2, -1) - middle


STILL = RigidMotion()


def seen(motion=STILL):
    """What a frame with a motion sees: at R x + shift, the scene's place x."""
    light = scene(motion.inverse().places(places())).reshape(SHAPE)
    return (128 + 0.8 * light).astype(np.float32)


def test_a_motion_after_its_inverse_is_none():
    both = MOTION.after(MOTION.inverse())
    assert both.corner_distance(RigidMotion(), SHAPE) < 1e-12
    # A turn alone moves corners by the chord over their distance from the centre.
    radius = np.hypot(*((n - 1) / 2 for n in SHAPE))
    turned = RigidMotion(0.1).corner_distance(RigidMotion(), SHAPE)
    assert turned == pytest.approx(2 * radius * np.sin(0.05))


@pytest.mark.parametrize(
    "curve", some([lambda z: z**1.1 / 1.7, lambda z: z, lambda z: 0.5 * z + 20])
)
def test_corners_are_found_to_a_twentieth_of_a_pixel_whatever_the_gain(curve):
    rng = np.random.default_rng(1)
    fixed, moving = (
        np.asarray(one + rng.normal(0, 1.5, SHAPE), np.float32)
        for one in (seen(), curve(seen(MOTION)))
    )
    whole = np.ones(SHAPE, dtype=bool)
    found = register_pictures([fixed], [moving], [whole], [whole])
    away = found.motion.corner_distance(MOTION, SHAPE)
    assert away < 0.05
    assert away < 5 * found.deviation
    assert found.deviation < 0.1


def test_what_is_clipped_does_not_matter():
    rng = np.random.default_rng(2)
    fixed, moving = seen(), seen(MOTION)
    valid = fixed < 140
    fixed = np.where(valid, fixed, 140 + rng.normal(0, 1, SHAPE)).astype(np.float32)
    found = register_pictures([fixed], [moving], [valid], [np.ones(SHAPE, dtype=bool)])
    assert found.motion.corner_distance(MOTION, SHAPE) < 0.1


def test_where_light_but_rises_a_shift_is_not_known():
    rng = np.random.default_rng(3)
    rise = 40 + np.linspace(0, 150, SHAPE[0])[:, None] * np.ones(SHAPE)
    first, second = ((rise + rng.normal(0, 0.5, SHAPE)).astype(np.float32) for _ in range(2))
    whole = np.ones(SHAPE, dtype=bool)
    found = register_pictures([first], [second], [whole], [whole])
    assert np.isinf(found.deviation)
    assert found.motion == RigidMotion()
    with pytest.raises(ValueError, match="of one size"):
        register_pictures([first], [second[1:]], [whole], [whole])


def test_resampled_values_are_the_scenes_and_clipped_pixels_do_not_bleed():
    moving = seen(MOTION)
    clipped = np.zeros(SHAPE, dtype=bool)
    clipped[50:60, 70:80] = True
    spoilt = np.where(clipped, np.float32(5000), moving)
    values, rests, outside = resample_moved(moving, MOTION, clipped)
    inside = np.s_[8:-8, 8:-8]
    assert np.abs(values - seen())[inside][~outside[inside]].max() < 0.5
    # A spline's weights fall to 7 % two pixels away, and alternate: 5000 would show.
    spoilt[clipped] = 255
    bled = resample_moved(spoilt, MOTION, clipped)[0]
    assert np.abs(bled - seen())[inside][~(outside | rests)[inside]].max() < 12
    assert 100 <= rests.sum() < 200
    # Outside: a border of the turned and shifted picture.
    assert 0.02 < outside.mean() < 0.1


def test_the_noise_of_resampled_pixels_is_at_most_a_pixels():
    noise = np.random.default_rng(4).normal(0, 1, SHAPE)
    values, _, outside = resample_moved(noise, MOTION, np.zeros(SHAPE, dtype=bool))
    assert 0.3 < values[~outside].var() < 1.0
