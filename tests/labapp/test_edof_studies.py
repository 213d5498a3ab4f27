"""The studies of deconvolution and of extended depth of field, piece by piece."""

import json

import cv2
import numpy as np
import pytest

from labapp.files.reading import bundled_path
from labapp.studies.cubic_edof import (
    STAR_DISTANCES,
    CubicEdofSettings,
    _defocus_and_strength,
    _depth_invariance_row,
    _zeros_row,
    frame_layer_indices,
    separability_residual,
)
from labapp.studies.study_lookup import find_study, read_study_settings, with_study_metadata
from optics.camera import Camera
from optics.patterns import cubic_phase_mask
from optics.psf import psf


@pytest.mark.parametrize("name", ["cubic-edof", "deconvolution"])
@pytest.mark.parametrize("quick", [False, True])
def test_a_study_has_a_plan_for_the_bench(name, quick):
    study = find_study(name)
    settings = read_study_settings(name, [], quick=quick)
    made = with_study_metadata(study.plan(settings, Camera()), name, settings, 3)
    assert made.seed == 3
    assert json.loads(made.metadata["study_settings"]) == json.loads(settings.model_dump_json())
    assert bundled_path(study.scene).exists()


def test_layers_lie_where_the_photograph_has_them():
    """Of a frame like the photograph: a pixel's layer is that of the place 1.05 times nearer to the
    middle."""
    layers = frame_layer_indices((512, 768))
    depth = cv2.imread(str(bundled_path("studies/cubic-edof-depth.png")), cv2.IMREAD_UNCHANGED)
    for y, x in ((100, 300), (400, 200), (400, 500), (256, 384), (500, 700)):
        v, u = round((y - 256) / 1.05) + 256, round((x - 384) / 1.05) + 384
        assert layers[y, x] == (0 if depth[v, u] == 2 else 1)
    assert 0.2 < (layers == 0).mean() < 0.5


def test_a_product_has_nothing_left_out_and_a_sum_of_two_has_its_share():
    rng = np.random.default_rng(0)
    a, b = np.linalg.qr(rng.normal(size=(9, 2)))[0].T, np.linalg.qr(rng.normal(size=(8, 2)))[0].T
    one, other = np.outer(a[0], b[0]), np.outer(a[1], b[1])
    offset = 3 * np.sign(one.sum()) * one
    assert separability_residual(offset) == pytest.approx(0, abs=1e-12)
    mixed = 3 * one + other
    if mixed.sum() > 0:
        assert separability_residual(mixed) == pytest.approx(1 / np.sqrt(10), rel=1e-9)


def test_the_plates_psf_depends_less_on_depth_and_is_a_product():
    """By the engine's own PSFs of the ideal panel at both distances."""
    camera, wavelength = Camera(), 550e-9
    pixels = camera.sensor.window_plane((128, 128))
    psfs = {}
    for pattern, strength in (("neutral", 0.0), ("cubic", CubicEdofSettings().strength_rad)):
        phase = cubic_phase_mask(camera.panel, strength)
        for star, distance in STAR_DISTANCES.items():
            made = psf(camera, phase, distance=distance, wavelength=wavelength, pixels=pixels)
            psfs[star, pattern] = made.value.double().numpy()
    row = _depth_invariance_row(psfs)
    assert (
        row.value
        > np.corrcoef(psfs["star", "neutral"].ravel(), psfs["star-far", "neutral"].ravel())[0, 1]
    )


def test_the_plate_has_no_zeros_where_the_open_aperture_has():
    row = _zeros_row(*_defocus_and_strength(Camera(), CubicEdofSettings()))
    assert row.value > 0.1
    assert row.ours.startswith("open 0.0")


def test_the_far_layer_is_as_far_as_its_star():
    """The middles of two layers at even steps of one over the distance."""
    text = bundled_path("studies/cubic-edof.toml").read_text()
    assert "offset_px = 340.909" in text
    near, far = (1000 / (v * 90.909 + 340.909) for v in (2, 1))
    step = (1 / near - 1 / far) / 2
    middles = [1 / (1 / near - (k + 0.5) * step) for k in (0, 1)]
    assert middles == pytest.approx(list(STAR_DISTANCES.values()), rel=1e-4)
