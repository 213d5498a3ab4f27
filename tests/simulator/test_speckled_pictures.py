"""Speckle in pictures: its variance against drawn surfaces, and a pattern that stays."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from judges.rough_surface import speckled
from optical_situations import CAMERA, situation

import simulator.imaging
from optics.light import Band
from optics.speckle import RoughSurface
from simulator.effects.picture_norms import estimated_norms, minimum_norms
from simulator.effects.pixel_effects import Speckle
from simulator.imaging import Imaging
from simulator.mount import Mount
from simulator.recipe import Recipe
from simulator.scene import Flat
from simulator.speckle import speckle_pattern, speckle_variance

NARROW = Band(550e-9, 2e-9)
PANEL = replace(CAMERA.panel, unmodulated=0.0)
ROUGH = Flat(1.0, 1e8, speckle=RoughSurface(20e-6))


def seen(target=ROUGH, band=NARROW, camera=None, **more):
    return situation(target, camera or replace(CAMERA, panel=PANEL), band, **more)


def recipe(s, on: bool) -> Recipe:
    made = Recipe.minimal(s).with_changes(shot="Poisson", read_noise=True)
    return Speckle().add_to_recipe(made, s, 1) if on else made


@pytest.mark.parametrize("roughness", [2e-6, 60e-6])
def test_its_variance_is_that_of_drawn_surfaces(roughness):
    s = seen(replace(ROUGH, speckle=RoughSurface(roughness)))
    centre, width = NARROW.centre, NARROW.support[1] - NARROW.support[0]
    waves = centre + width * (np.arange(24) + 0.5) / 24 - width / 2
    rng, light = np.random.default_rng(4), [float(NARROW.transmission(x)) for x in waves]
    drawn = [speckled(rng, s.camera, 4, roughness, waves, light) for _ in range(60)]
    wanted = np.var(drawn) / np.mean(drawn) ** 2
    assert speckle_variance(s) == pytest.approx(wanted, rel=0.06)


@pytest.mark.parametrize("share", [1.0, 0.2])
def test_a_picture_varies_by_it_beside_the_sensors_noise(share):
    s = seen(replace(ROUGH, speckle=RoughSurface(1e-6, patterns=1 / share)))
    plain, found = (Imaging(0.0).picture_moments(s, recipe(s, on)) for on in (False, True))
    assert torch.allclose(found.mean, plain.mean, rtol=1e-4)
    added = speckle_variance(s) * plain.mean**2
    assert torch.allclose(found.variance, plain.variance + added, rtol=1e-3)


def test_a_still_scene_keeps_its_pattern():
    """Through frames and exposures; another wavelength, pattern or target has another."""
    one, longer = speckle_pattern(seen()), speckle_pattern(seen(exposure=0.05))
    assert torch.equal(one, longer)
    for other in (
        seen(band=Band(560e-9, 2e-9)),
        seen(replace(ROUGH, name="another")),
        seen(mount=Mount(flip_x=True)),
    ):
        assert not torch.allclose(one, speckle_pattern(other), rtol=0.1)


def test_frames_show_the_pattern_and_the_plan_has_it():
    s, imaging = seen(), Imaging(1e-2)
    plan = imaging.plan(s)
    assert plan.level("speckle") == 1
    stream = imaging.stream(s, plan)
    frames = np.stack([stream.frame(torch.Generator().manual_seed(k)) for k in range(20)])
    light = frames.mean(0) - s.camera.sensor.black_level
    pattern = speckle_pattern(s).numpy()
    assert np.corrcoef(light.ravel(), pattern.ravel())[0, 1] > 0.99


def test_a_turned_panel_turns_no_grain():
    turned = seen(mount=Mount(rotation=np.pi / 2))
    square = replace(CAMERA, panel=replace(PANEL, shape=(24, 24)))
    assert speckle_variance(seen(mount=Mount(), camera=square)) == pytest.approx(
        speckle_variance(seen(mount=Mount(rotation=np.pi / 2), camera=square)), rel=0.05
    )
    assert speckle_variance(turned) == pytest.approx(speckle_variance(seen()), rel=0.05)


@pytest.mark.parametrize("radiance", [1e4, 1e6, 3e9])
def test_bounds_hold_for_dim_and_full_pixels(radiance):
    s = seen(replace(ROUGH, radiance=radiance))
    every = recipe(s, True).with_changes(clipping=True, quantisation=True)
    found, without = (
        Imaging(0.0).picture_moments(s, every.with_changes(speckle=on)) for on in (True, False)
    )
    bound = Speckle().error_bound(s, 0)
    norm = torch.linalg.vector_norm
    assert norm(found.mean - without.mean) <= bound.mean + 1e-4 * norm(without.mean)
    assert norm(found.variance - without.variance) <= bound.variance * (1 + 1e-3)
    sigma = norm(found.variance.sqrt() - without.variance.sqrt())
    assert sigma <= bound.sigma * (1 + 1e-3)


def test_a_smooth_object_has_no_such_effect(monkeypatch):
    s = seen(Flat(1.0, 1e8))
    assert not Speckle().is_present(s)
    assert speckle_variance(s) == 0


def test_what_does_not_speckle_costs_nothing(monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("called for nothing")

    for name in ("speckle_pattern", "moments_with_speckle"):
        monkeypatch.setattr(simulator.imaging, name, never)
    for name in ("error_bound", "estimated_error", "added_operations", "add_to_recipe"):
        monkeypatch.setattr(Speckle, name, never)
    s, imaging = seen(Flat(1.0, 1e8)), Imaging(1e-3)
    plan = imaging.plan(s)
    imaging.picture_moments(s, plan.recipe)
    imaging.stream(s, plan)


def test_errors_are_relative_to_a_noise_that_has_it():
    """Relative to the light's own noise, all that changes the light would count ten times."""
    s = seen()
    picture = Imaging(0.0).picture_moments(s, recipe(s, True))
    for norms in (minimum_norms(s), estimated_norms(s)):
        sigma = float(picture.variance.sqrt().double().norm())
        assert 0.5 * sigma <= norms.sigma <= 1.01 * sigma
        assert norms.variance <= float(picture.variance.double().norm())
