"""Lenses and sensors with several imperfections at once, and what costs nothing without them.

A few of the cameras that `make figures ONLY="imperfect cameras"` takes.
"""

from dataclasses import replace
from itertools import islice

import pytest
from figures.imperfect_cameras import NAMES, draws, rendered
from optical_situations import CAMERA, situation

import simulator.formation.mean_picture as picture
import simulator.formation.objects as objects
from optics.camera import Ghost
from optics.light import Band
from simulator.effects.registry import EFFECTS
from simulator.imaging import Imaging

ADDED = [one for one in EFFECTS if one.name in {*NAMES} - {"vignetting"}]
RENDERING = (
    (objects, "angle_share"),
    (picture, "vibration_transfer"),
    (picture, "distort"),
    (picture, "ghost_on_pixels"),
    (picture, "cast_shadows"),
    (picture, "mix_neighbours"),
)


def never(*args, **kwargs):
    raise AssertionError("called for nothing")


@pytest.mark.parametrize("number", range(4))
def test_a_picture_is_what_rays_and_sums_make_of_it(number):
    draw = next(islice(draws(4, 0.1), number, None))
    wanted = draw.judged(draw.fine_picture())
    found = rendered(draw.situation, NAMES, 3, aperture=True)
    assert found == pytest.approx(wanted, abs=0.03 * wanted.max())
    assert ((found - wanted) ** 2).sum() <= 0.01**2 * (wanted**2).sum()


def test_what_a_camera_has_not_got_costs_nothing(monkeypatch):
    """Neither to decide nor to render it."""
    assert len(ADDED) == len(RENDERING)
    for effect in ADDED:
        for name in ("error_bound", "estimated_error", "added_operations", "add_to_recipe"):
            monkeypatch.setattr(type(effect), name, never)
    for module, name in RENDERING:
        monkeypatch.setattr(module, name, never)
    s, imaging = situation(), Imaging(1e-3)
    imaging.electrons(s, imaging.plan(s).recipe)


def test_what_a_plan_leaves_out_is_not_rendered(monkeypatch):
    for module, name in RENDERING:
        monkeypatch.setattr(module, name, never)
    sensor = replace(CAMERA.sensor, crosstalk=1e-6, dust=((0.0, 0.0, 1e-8),), dust_distance=1e-3)
    lens = replace(CAMERA.lens, distortion=(1e-3, 0.0))
    camera = replace(CAMERA, sensor=sensor, lens=lens, vibration=1e-9, ghosts=(Ghost(1e-6, -1.0),))
    s = situation(camera=camera, band=Band(550e-9, 20e-9, effective_index=2.0))
    plan = Imaging(1e-2).plan(s)
    left_out = [one.name for one in ADDED if one.is_present(s) and not plan.level(one.name)]
    assert len(left_out) == len(ADDED)
    Imaging(1e-2).electrons(s, plan.recipe)
