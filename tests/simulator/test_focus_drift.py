"""Drift of focus against lenses that are out of focus by as much, frame by frame."""

import math
from dataclasses import replace

import numpy as np
import pytest
from optical_situations import CAMERA, STAR, finest, rendered, situation

from optics.caching import ByteCache
from optics.camera import Camera
from simulator.effects.lens_effects import AxialColour, FocusDrift
from simulator.effects.picture_norms import minimum_norms
from simulator.imaging import Imaging
from simulator.scene import Scene
from simulator.situation import Situation
from simulator.world import World

DRIFTING = replace(CAMERA, focus_drift=-4e-3, focus_drift_time=600.0)
COLOUR = ((450e-9, 3e-3), (650e-9, -3e-3))
COLOURED = replace(DRIFTING, lens=replace(CAMERA.lens, axial_colour=COLOUR))


def seen(minutes: float, camera: Camera = DRIFTING) -> Situation:
    return situation(STAR, camera, moment=60.0 * minutes)


def picture(s: Situation, **levels: int) -> np.ndarray:
    named = {name.replace("_", " "): level for name, level in levels.items()}
    return rendered(s, finest(s) | {"panel orders": 0} | named, ByteCache())


def out_of_focus(shift: float) -> Camera:
    """By the path at its edge, half of 1/z - 1/z' times r²; Zernike (2, 0) goes from -√3 to √3."""
    lens, z = CAMERA.lens, CAMERA.lens.image_distance
    edge = (1 / z - 1 / (z + shift)) * (lens.stop_diameter / 2) ** 2 / 2
    path = ((2, 0, edge / (2 * math.sqrt(3))),)
    return replace(CAMERA, lens=replace(lens, aberrations=path))


@pytest.mark.parametrize("minutes", [0, 5])
def test_a_frame_is_out_of_focus_by_its_time(minutes):
    shift = -4e-3 * (1 - math.exp(-(60 * minutes + 0.005) / 600))
    found, wanted = picture(seen(minutes)), picture(seen(0, out_of_focus(shift)))
    assert np.linalg.norm(found - wanted) <= 0.01 * np.linalg.norm(wanted)
    sharp = np.linalg.norm(picture(seen(0, CAMERA)) - wanted) / np.linalg.norm(wanted)
    assert (sharp > 0.05) == (minutes > 0)


@pytest.mark.parametrize("camera", [DRIFTING, COLOURED], ids=["drift", "and colour"])
@pytest.mark.parametrize(
    "minutes", [5, *(pytest.param(one, marks=pytest.mark.sweep) for one in (0.05, 40))]
)
def test_no_more_changes_than_the_bound_and_no_less_is_left(camera, minutes):
    s = seen(minutes, camera)
    found = picture(s)
    for effect in (FocusDrift(), AxialColour()):
        if effect.is_present(s):
            change = np.linalg.norm(found - picture(s, **{effect.name.replace(" ", "_"): 0}))
            assert change <= effect.error_bound(s, 0).mean
    assert minimum_norms(s).mean <= np.linalg.norm(found)


def test_frames_of_one_simulator_drift_and_a_warm_one_shows_the_same_again():
    world = World(DRIFTING, Scene({"star": STAR}), tol=1e-3)
    frames = []
    for number, minutes in enumerate((0, 10, 600, 900, 0)):
        world.begin_frame(1, number, 0, start_time=60.0 * minutes)
        rates, plan = world.electron_rates(0.01)
        frames.append(rates.numpy())
        assert plan.recipe.focus_drift or not minutes
    cold, warmer, warm, again, anew = frames
    assert warm.max() < warmer.max() < cold.max()
    assert np.array_equal(warm, again)
    assert np.array_equal(cold, anew)
    assert world.imaging.plan_count == 3


def test_a_camera_at_rest_has_none():
    assert not FocusDrift().is_present(situation())
    weak = replace(CAMERA, focus_drift=1e-8)
    s = seen(60, weak)
    assert FocusDrift().is_present(s)
    assert not Imaging(1e-2).plan(s).recipe.focus_drift
    assert CAMERA.focus_at(1e6) == 0


@pytest.mark.parametrize(
    "data", [{"focus_drift": math.nan}, {"focus_drift": 0.1}, {"focus_drift_time": 0.0}]
)
def test_data_that_cannot_be_are_refused(data):
    with pytest.raises(ValueError, match=next(iter(data))):
        replace(CAMERA, **data)
