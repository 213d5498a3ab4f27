"""The model of a snapshot spectral camera and its calibration from frames, beside finer models."""

import math

import numpy as np
import pytest
import torch
from judges.rings import bayer_frame, ring_psf, vary_response
from scipy.ndimage import shift

from optics.multispectral import (
    BandTransmission,
    ModelUncertainty,
    SnapshotCalibration,
    SnapshotModel,
    calibrate_from_frames,
)
from optics.multispectral.snapshot_model import ParameterLayout, move_psf

RESPONSE = np.array([[0.05, 0.1, 0.9], [0.15, 0.8, 0.07], [0.8, 0.1, 0.03]])
RADII = (6.0, 7.0, 8.0)
REACH = 11


def rings(order=0.2, centres=None, scale=1.0, reach=REACH):
    centres = np.zeros((3, 2)) if centres is None else centres
    orders = np.broadcast_to(order, 3)
    return np.stack([
        ring_psf(scale * radius, one, centre, reach=reach)
        for radius, one, centre in zip(RADII, orders, centres, strict=True)
    ])  # fmt: skip


def model(**known) -> SnapshotModel:
    given = {"zeroth_order": 0.2, "neutral": rings(1.0)} | known
    return SnapshotModel.create(rings(), RESPONSE, **given)


def vector(camera, **deviations) -> torch.Tensor:
    found = torch.zeros(camera.layout.count, dtype=torch.float64)
    for name, value in deviations.items():
        found[getattr(camera.layout, name)] = torch.as_tensor(value, dtype=torch.float64)
    return found


def relative_error(found, wanted) -> float:
    found, wanted = np.asarray(found), np.asarray(wanted)
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))


def test_a_psf_moves_as_its_splines_do_by_scipy():
    psf = ring_psf(5.0, 0.3, reach=10)
    moved = move_psf(torch.from_numpy(psf), 1.0, torch.tensor([0.3, -0.45]).double(), 0)
    assert relative_error(moved, shift(psf, (0.3, -0.45), order=3)) < 2e-3


@pytest.mark.parametrize(("scale", "centre"), [(1.0, (0.5, 0.0)), (1.02, (-0.2, 0.4))])
def test_a_psf_moves_as_rendering_it_anew(scale, centre):
    """The width of a rendered ring doesn't grow with its radius, which is the model's error."""
    old, new = ring_psf(8.0, 0.0, reach=13), ring_psf(8.0 * scale, 0.0, centre, reach=15)
    moved = move_psf(torch.from_numpy(old), scale, torch.tensor(centre).double(), 2)
    assert relative_error(moved, new) < 0.07
    assert relative_error(np.pad(old, 2), new) > 0.25
    assert float(moved.sum()) == pytest.approx(1, abs=1e-3)


def test_no_deviation_is_the_nominal_camera():
    camera = model()
    psfs = camera.psfs(vector(camera))
    inside = (slice(None), *2 * (slice(camera.margin, -camera.margin),))
    assert relative_error(psfs[inside], rings()) < 1e-12
    assert float(psfs.sum()) == pytest.approx(3, abs=1e-3)
    np.testing.assert_allclose(camera.response_at(vector(camera)), RESPONSE)


def test_zeroth_orders_and_ratios_change_as_they_say():
    camera = model()
    deviation = vector(camera, zeroth_orders=[0.05, 0, -0.1], log_ratios=[0, 0, 0, 0.1, 0, 0])
    psfs = camera.psfs(deviation)[:, camera.margin : -camera.margin, camera.margin : -camera.margin]
    assert relative_error(psfs, rings([0.25, 0.2, 0.1])) < 1e-12
    found, first = camera.response_at(deviation).numpy(), RESPONSE[:, 0]
    # Blue is the strongest of band 0; its ratios follow in the order of the channels.
    assert found[1, 0] / found[2, 0] == pytest.approx(first[1] / first[2] * math.exp(0.1))
    assert found[0, 0] / found[2, 0] == pytest.approx(first[0] / first[2])
    np.testing.assert_allclose(found.sum(0), RESPONSE.sum(0))


def test_derivatives_are_those_of_differences():
    camera = model()
    at = (
        0.01 * torch.randn(camera.layout.count, generator=torch.Generator().manual_seed(0)).double()
    )
    psf_slopes, response_slopes = camera.psf_slopes(at), camera.response_slopes(at)
    for number in range(camera.layout.count):
        way = 1e-5 * torch.eye(camera.layout.count, dtype=torch.float64)[number]
        wanted = (camera.psfs(at + way) - camera.psfs(at - way)) / 2e-5
        mine = (camera.layout.band_places == number)[..., None, None]
        np.testing.assert_allclose((psf_slopes * mine).sum(0), wanted, atol=1e-6)
        wanted = (camera.response_at(at + way) - camera.response_at(at - way)) / 2e-5
        mine = (camera.layout.ratio_places == number)[:, None]
        np.testing.assert_allclose((response_slopes * mine).sum(0), wanted, atol=1e-8)


def test_psfs_and_response_record_derivatives():
    camera = model()
    at = vector(camera).requires_grad_()
    light = camera.psfs(at)[0, 14].square().sum() + camera.response_at(at)[0].sum()
    (found,) = torch.autograd.grad(light, at)
    way = vector(camera, zeroth_orders=1e-5, scale=1e-5, centres=1e-5, log_ratios=1e-5)
    ends = [
        float(camera.psfs(one)[0, 14].square().sum() + camera.response_at(one)[0].sum())
        for one in (way, -way)
    ]
    assert float(found.sum()) == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-5)


def test_the_nominal_uncertainty_is_that_of_drawn_cameras():
    """Of zeroth orders with a common and an own error, and of ratios of independent channels."""
    rng, camera = np.random.default_rng(0), model()
    wanted = camera.layout.prior_covariance(ModelUncertainty(response=0.05))
    logs = 0.05 * rng.standard_normal((20000, 3))
    ratios = (logs[:, 1:] - logs[:, :1]).T
    places = [camera.layout.log_ratios.start + number * 3 for number in (0, 1)]
    np.testing.assert_allclose(wanted[np.ix_(places, places)], np.cov(ratios), atol=1.5e-4)
    orders = 0.05 * rng.standard_normal(20000) + 0.015 * rng.standard_normal((2, 20000))
    np.testing.assert_allclose(wanted[:2, :2], np.cov(orders), atol=1.5e-4)


def star_frames(psfs, response, light, noise, rng, place=(0, 0), side=56):
    frames = []
    for band, psf in enumerate(psfs):
        picture = np.zeros((len(psfs), side, side))
        first = [side // 2 + move - len(psf) // 2 for move in place]
        picture[band, first[0] : first[0] + len(psf), first[1] : first[1] + len(psf)] = psf
        frames.append(bayer_frame(light * picture, response))
    frames = np.stack(frames)
    return frames + rng.normal(0, noise, frames.shape)


def flat_frames(response, light, noise, rng, side=64):
    even = light * np.eye(3)[:, :, None, None] * np.ones((side, side))
    frames = np.stack([bayer_frame(one, response) for one in even])
    return frames + rng.normal(0, noise, frames.shape)


def test_frames_find_the_camera_within_its_uncertainty():
    """Stars drawn finer than the model's pixels, somewhere in the frame; three cameras."""
    inside, errors = [], []
    camera = model()
    for seed in range(3):
        rng = np.random.default_rng(seed)
        response = vary_response(RESPONSE, 0.05, rng)
        centres, order = 0.5 * rng.standard_normal((3, 2)), 0.2 + 0.05 * rng.standard_normal()
        psfs = rings(order, centres, 1 + 0.01 * rng.standard_normal(), reach=16)
        found = calibrate_from_frames(
            SnapshotCalibration.nominal(camera),
            flats=flat_frames(response, 0.5, 0.01, rng),
            stars=star_frames(psfs, response, 15.0, 0.01, rng, (4, -3)),
            noise=0.01,
        )
        listed = {one.name: one for one in found.parameters}
        for band, channels in enumerate(camera.others.T):
            strongest = int(camera.strongest[band])
            true = response[channels, band] / response[strongest, band]
            names = [f"{'RGB'[c]}/{'RGB'[strongest]} of band {band}" for c in channels]
            inside += [
                listed[one].lower <= value <= listed[one].upper
                for one, value in zip(names, true, strict=True)
            ]
            share = listed[f"zeroth order's share of band {band}"]
            inside.append(share.lower <= order <= share.upper)
            errors.append(share.value - order)
        # Only the distances between the centres are known.
        for axis, letter in enumerate("yx"):
            places = [listed[f"centre {letter} of band {band}"].value for band in range(3)]
            np.testing.assert_allclose(np.diff(places), np.diff(centres[:, axis]), atol=0.15)
    assert np.mean(inside) > 0.85
    assert np.std(errors) < 0.01


def test_flat_frames_give_the_deviation_of_a_mean():
    """The logarithm of a ratio of two means, with caution, where the prior says little."""
    rng, camera = np.random.default_rng(1), model()
    wide = SnapshotCalibration.nominal(camera, ModelUncertainty(response=1.0))
    found = calibrate_from_frames(wide, flats=flat_frames(RESPONSE, 0.5, 0.01, rng), noise=0.01)
    ratio = next(one for one in found.parameters if one.name == "G/R of band 2")
    # A quarter of the pixels is red, and half of them green.
    red, green = (0.01 / (0.5 * s * math.sqrt(64 * 64 * n)) for s, n in ((0.9, 1 / 4), (0.07, 0.5)))
    assert ratio.deviation / ratio.value == pytest.approx(
        1.5**0.5 * math.hypot(red, green), rel=0.02
    )
    assert abs(ratio.value / ratio.nominal - 1) < 4 * math.hypot(red, green)
    # Flats say nothing of the PSFs.
    share = next(one for one in found.parameters if one.name.startswith("zeroth order"))
    assert share.deviation == pytest.approx(math.hypot(0.05, 0.015), rel=1e-6)


def test_photon_noise_and_misfits_widen_the_intervals():
    rng, camera = np.random.default_rng(2), model()
    nominal = SnapshotCalibration.nominal(camera)
    stars = star_frames(rings(), RESPONSE, 15.0, 0.01, rng)
    spots = stars.copy()
    spots[:, ::7, ::5] += 0.2

    def deviation(frames, **known) -> float:
        return (
            calibrate_from_frames(nominal, stars=frames, noise=0.01, **known)
            .parameters[0]
            .deviation
        )

    assert deviation(stars, photon_variance=1e-3) > 1.1 * deviation(stars)
    assert deviation(spots) > 1.5 * deviation(stars)


def test_one_displaced_band_displaces_that_band_alone():
    """What most bands have in common is the reference, unlike the mean of all."""
    camera = model()
    places = torch.tensor([0.0, 0.0, 0.5, 0.0, 0.0, 0.0])
    small = camera.layout.prior_covariance(ModelUncertainty(centre=0.01))
    found = SnapshotCalibration(camera, vector(camera, centres=places), small)
    np.testing.assert_allclose(found.relative_deviation[camera.layout.centres], places, atol=0.01)
    moved = SnapshotCalibration(camera, vector(camera, centres=places + 3), small)
    np.testing.assert_allclose(moved.relative_deviation, found.relative_deviation, atol=1e-9)
    ones = torch.ones(3, dtype=torch.float64)
    common = torch.zeros(2, camera.layout.count, dtype=torch.float64)
    common[:, camera.layout.centres] = torch.block_diag(ones, ones)
    wider = SnapshotCalibration(camera, found.deviation, small + common.mT @ common)
    places = camera.layout.centres
    assert float(wider.covariance[places, places].diagonal().min()) > 1
    assert float(wider.relative_covariance[places, places].diagonal().max()) < 0.01


def test_what_is_indeterminate_is_said_and_a_transmission_determines_gains():
    camera = model()
    words = " ".join(SnapshotCalibration.nominal(camera).indeterminate)
    assert "gain" in words
    assert "shift" in words
    known = BandTransmission(np.array([0.5, 0.6, 0.7]), np.array([0.01, 0.02, 0.03]))
    measured = SnapshotCalibration.nominal(camera, transmission=known)
    assert "gain" not in " ".join(measured.indeterminate)
    np.testing.assert_allclose(measured.response, RESPONSE * [0.5, 0.6, 0.7])
    last = measured.parameters[-1]
    assert (last.value, last.deviation) == (pytest.approx(0.7), pytest.approx(0.03))


@pytest.mark.parametrize(("known", "words"), [
    ({"zeroth_order": 1.0}, "zeroth_order"),
    ({"zeroth_order": [0.1, 0.2]}, "zeroth_order"),
    ({"neutral": rings(1.0)[:, 1:]}, "neutral"),
    ({"channels": "RG"}, "response"),
    ({"pattern": ("RG", "GX")}, "pattern"),
])  # fmt: skip
def test_a_malformed_camera_is_refused(known, words):
    with pytest.raises(ValueError, match=words):
        model(**known)
    with pytest.raises(ValueError, match="response"):
        SnapshotModel.create(rings(), RESPONSE - 0.05, zeroth_order=0.2)


@pytest.mark.parametrize(("known", "words"), [
    ({}, "neither flats nor stars"),
    ({"flats": np.ones((2, 8, 8))}, "flats"),
    ({"flats": np.ones((3, 1, 1))}, "whole pattern"),
    ({"stars": np.ones((3, 20, 20))}, "stars"),
    ({"flats": np.full((3, 8, 8), np.nan)}, "flats"),
    ({"flats": np.ones((3, 8, 8)), "noise": 0.0}, "noise"),
    ({"flats": np.ones((3, 8, 8)), "photon_variance": -1.0}, "photon_variance"),
])  # fmt: skip
def test_unusable_frames_are_refused(known, words):
    with pytest.raises(ValueError, match=words):
        calibrate_from_frames(SnapshotCalibration.nominal(model()), **({"noise": 0.01} | known))


def test_malformed_uncertainty_and_transmission_are_refused():
    with pytest.raises(ValueError, match="centre"):
        ModelUncertainty(centre=0.0)
    with pytest.raises(ValueError, match="transmission"):
        BandTransmission(np.array([0.5, 0.0]), np.array([0.1, 0.1]))
    with pytest.raises(ValueError, match="deviations"):
        BandTransmission(np.array([0.5, 0.1]), np.array([0.1]))
    two = BandTransmission(np.ones(2), np.zeros(2))
    with pytest.raises(ValueError, match="bands"):
        SnapshotCalibration.nominal(model(), transmission=two)
    assert ParameterLayout(3, 2).count == 16
