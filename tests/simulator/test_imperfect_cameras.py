"""Lenses and sensors with several imperfections at once, and what costs nothing without them.

A few of the cameras that `make figures ONLY="imperfect cameras"` takes.
"""

from dataclasses import replace
from itertools import islice

import pytest
from figures.imperfect_cameras import NAMES, draws, rendered
from optical_situations import CAMERA, situation

import simulator.formation.kernels as kernels
import simulator.formation.mean_picture as picture
import simulator.formation.objects as objects
from optics.camera import Camera, Ghost, Lens
from optics.camera.field_aberrations import FieldAberrations
from optics.light import Band
from simulator.effects.registry import EFFECTS
from simulator.imaging import Imaging

ADDED = [one for one in EFFECTS if one.name in {*NAMES} - {"vignetting"}]
RENDERING = (
    (Lens, "defocused"),
    (kernels, "add_aberrations"),
    (objects, "angle_share"),
    *((picture, name) for name in (
        "rfft2_frequencies", "distort", "ghost_on_pixels", "cast_shadows", "mix_neighbours"
    )),
)  # fmt: skip


def never(*args, **kwargs):
    raise AssertionError("called for nothing")


@pytest.mark.parametrize(
    "number", [1, 5, *(pytest.param(one, marks=pytest.mark.sweep) for one in (0, 2, 3, 4))]
)
def test_a_picture_is_what_rays_and_sums_make_of_it(number):
    draw = next(islice(draws(6, 0.1), number, None))
    wanted = draw.judged()
    found = rendered(draw.situation, NAMES, 3, aperture=True)
    assert found == pytest.approx(wanted, abs=0.03 * wanted.max())
    # The judge takes light away where it lands, not where it comes from: a tenth of a percent.
    assert ((found - wanted) ** 2).sum() <= 0.011**2 * (wanted**2).sum()


def test_what_a_camera_has_not_got_costs_nothing(monkeypatch):
    """Neither to decide nor to render it."""
    parts = (*RENDERING, (Lens, "image_scale"), (Camera, "focus_at"))
    assert len(ADDED) == len(parts)
    for effect in ADDED:
        for name in ("error_bound", "estimated_error", "added_operations", "add_to_recipe"):
            monkeypatch.setattr(type(effect), name, never)
    for owner, name in parts:
        monkeypatch.setattr(owner, name, never)
    s, imaging = situation(), Imaging(1e-3)
    imaging.electrons(s, imaging.plan(s).recipe)


def test_what_a_plan_leaves_out_is_not_rendered(monkeypatch):
    sensor = replace(CAMERA.sensor, crosstalk=1e-6, dust=((0.0, 0.0, 1e-8),), dust_distance=1e-3)
    lens = replace(
        CAMERA.lens,
        distortion=(1e-3, 0.0),
        axial_colour=((400e-9, 1e-9), (700e-9, -1e-9)),
        lateral_colour=((400e-9, 1e-9), (700e-9, -1e-9)),
        field_aberrations=FieldAberrations(1e-3, 1e-12, 1e-12, 1e-12),
    )
    camera = replace(
        CAMERA, sensor=sensor, lens=lens, vibration=1e-9, ghosts=(Ghost(1e-6, -1.0),),
        focus_drift=1e-8, focus_drift_time=1e-3,
    )  # fmt: skip
    s = situation(camera=camera, band=Band(550e-9, 5e-9, effective_index=2.0))
    # The whole tolerance is for what is left out.
    plan = Imaging(1e-2, {"filter bandwidth": "33"}).plan(s)
    left_out = [one.name for one in ADDED if one.is_present(s) and not plan.level(one.name)]
    assert len(left_out) == len(ADDED)
    for owner, name in RENDERING:
        monkeypatch.setattr(owner, name, never)
    Imaging(1e-2).electrons(s, plan.recipe)
