"""A lens' ghosts against discs by hand and cameras of other pixels, and their bounds."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from optical_situations import CAMERA, STAR, rendered, situation

from optics.caching import ByteCache
from optics.camera import Camera, Ghost
from simulator.effects.glare import LensGhosts
from simulator.effects.picture_norms import minimum_norms
from simulator.imaging import Imaging
from simulator.scene import Flat, PhotographPrint

LEVELS = {"diffraction": 1, "light sampling": 2, "PSF reach": 1, "pixel aperture": 1}
EFFECT = LensGhosts()


def reflecting(*ghosts: Ghost, camera: Camera = CAMERA) -> Camera:
    return replace(camera, ghosts=ghosts)


def seen(target, camera: Camera, ghosts: int) -> np.ndarray:
    return rendered(situation(target, camera), LEVELS | {"lens ghosts": ghosts}, ByteCache())


def smooth_print(cover: float) -> PhotographPrint:
    y, x = np.mgrid[-1:1:80j, -1:1:100j]
    image = 0.5 + 0.2 * np.sin(9 * x + 7 * y) + 0.2 * np.cos(11 * y - 5 * x)
    shown = np.repeat(image[..., None], 3, 2).astype(np.float32)
    return PhotographPrint(torch.from_numpy(shown), 1.0, 1e7, cover=cover)


@pytest.mark.parametrize("magnification", [-1.2, 0.7])
def test_a_stars_ghost_is_an_even_disc_on_the_other_side_or_the_same(magnification):
    ghost = Ghost(0.2, magnification, 160e-6)
    bare, both = (seen(STAR, reflecting(ghost), on) for on in (0, 1))
    added = both - 0.8 * bare
    pitch = CAMERA.sensor.pitch
    y, x = ((np.arange(n) - n // 2) * pitch for n in bare.shape)
    centre = [
        magnification * float((bare * at).sum() / bare.sum()) for at in (y[:, None], x[None, :])
    ]
    away = np.hypot(y[:, None] - centre[0], x[None, :] - centre[1])
    assert added.sum() == pytest.approx(0.2 * bare.sum(), rel=0.01)
    assert [(added * y[:, None]).sum() / added.sum(), (added * x).sum() / added.sum()] == (
        pytest.approx(centre, abs=0.05 * pitch)
    )
    even = 0.2 * bare.sum() * pitch**2 / (math.pi * 160e-6**2 / 4)
    # The star and its spot are 40 µm and less; their side lobes lie beyond the disc.
    inside = added[away < 80e-6 - 45e-6]
    assert len(inside) >= 9
    assert inside == pytest.approx(even, rel=0.08)
    assert np.abs(added[away > 80e-6 + 60e-6]).max() < 0.02 * even


def test_even_light_stays_even_and_a_small_ghost_is_denser():
    camera = reflecting(Ghost(0.1, -0.5, 50e-6), Ghost(0.02, 2.0))
    bare, both = (seen(Flat(1.0, 1e7), camera, on) for on in (0, 1))
    assert both == pytest.approx(bare * (0.88 + 0.1 / 0.25 + 0.02 / 4), rel=1e-5)
    s = situation(Flat(1.0, 1e7), camera)
    change = np.linalg.norm(both - bare)
    assert change <= EFFECT.error_bound(s, 0).mean <= 1.3 * change


@pytest.mark.parametrize("magnification", [-0.5, 0.8, -1.6])
def test_a_sharp_ghost_is_what_other_pixels_see(magnification):
    """Of a print that is larger than the frame; what lies beside it is in a small ghost."""
    sensor, printed = CAMERA.sensor, smooth_print(2.5)
    bare, both = (seen(printed, reflecting(Ghost(0.1, magnification)), on) for on in (0, 1))
    scale = abs(magnification)
    other = replace(CAMERA, sensor=replace(sensor, pitch=sensor.pitch / scale))
    # It covers as much of the scene on either frame.
    wanted = seen(smooth_print(2.5 * scale), other, 0)
    if magnification < 0:
        # Turned about the middle pixel, not about the middle of the frame.
        wanted = np.roll(wanted[::-1, ::-1], (1, 1), (0, 1))[1:, 1:]
        added = (both - 0.9 * bare)[1:, 1:]
    else:
        added = both - 0.9 * bare
    assert np.linalg.norm(added - 0.1 * wanted) <= 2e-3 * np.linalg.norm(0.1 * wanted)


@pytest.mark.parametrize(
    "target",
    [STAR, smooth_print(2.5), smooth_print(0.7)],
    ids=("star", "print beyond the frame", "print"),
)
@pytest.mark.parametrize("magnification", [-1.0, 0.6, -3.0])
@pytest.mark.parametrize("blur", [0.0, 6e-4])
def test_no_more_changes_than_the_bound_and_no_less_is_left(target, magnification, blur):
    camera = reflecting(Ghost(0.1, magnification, blur), Ghost(0.01, -magnification, blur / 2))
    s = situation(target, camera)
    bare, both = (seen(target, camera, on) for on in (0, 1))
    bound = EFFECT.error_bound(s, 0)
    assert np.linalg.norm(both - bare) <= bound.mean
    noise = CAMERA.sensor.read_noise**2
    sigmas = (np.sqrt(one.clip(0) + noise) for one in (both, bare))
    assert np.linalg.norm(np.subtract(*sigmas)) <= bound.sigma
    assert minimum_norms(s).mean <= np.linalg.norm(both)


def test_a_disc_that_is_wider_than_the_probes_margin_is_bounded():
    fine = replace(CAMERA, sensor=replace(CAMERA.sensor, pitch=1e-6, shape=(40, 60)))
    ghost = Ghost(0.1, -3.0, 300e-6)
    s = situation(STAR, reflecting(ghost, camera=replace(fine)))
    bound = EFFECT.error_bound(s, 0)
    # All of the star's light is beside this frame, and its ghost's disc is wider than that.
    electrons = s.picture_probe.off_plane_star_rate or s.picture_probe.total_with_margin
    even = 0.1 * electrons * s.exposure * 1e-12 / (math.pi * 300e-6**2 / 4)
    assert bound.mean >= 0.9 * even * math.sqrt(40 * 60)


def test_a_lens_without_ghosts_knows_nothing_of_them():
    assert not EFFECT.is_present(situation())
    assert not EFFECT.is_present(situation(camera=reflecting(Ghost(0.0, 1.0))))
    assert EFFECT.is_present(situation(camera=reflecting(Ghost(1e-6, 1.0))))


def test_a_ghost_of_a_much_wider_field_is_refused_in_words():
    large = replace(CAMERA, sensor=replace(CAMERA.sensor, shape=(800, 900)))
    camera = reflecting(Ghost(0.01, -0.1), camera=large)
    with pytest.raises(ValueError, match=r"picture is [0-9.]+ times as large; .* renders 16"):
        Imaging(1e-3).plan(situation(Flat(1.0, 1e7), camera))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ((1.1, 1.0), r"share is 1\.1"),
        ((-0.1, 1.0), "share is"),
        ((0.1, 0.0), "magnification is 0; give the ghost's size"),
        ((0.1, math.nan), "magnification is nan"),
        ((0.1, -1e4), "magnification is -10000"),
        ((0.1, 1.0, -1e-3), r"blur_diameter is -0\.001 m"),
        ((0.1, 1.0, math.inf), "blur_diameter is inf m"),
    ],
)
def test_a_ghost_that_cannot_be_is_refused(data, words):
    with pytest.raises(ValueError, match=words):
        Ghost(*data)


def test_ghosts_have_no_more_than_all_light():
    with pytest.raises(ValueError, match=r"ghosts have 1\.2 of the light together"):
        Camera(ghosts=(Ghost(0.6, 1.0), Ghost(0.6, -1.0)))
