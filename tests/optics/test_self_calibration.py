"""Calibration of a snapshot camera from the photograph alone, on a small scene of squares."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from judges.rings import bayer_frame, blurred_part, ring_psf

from optics.inverse import build_mosaic_observation
from optics.inverse.band_coupling import BandCoupling
from optics.multispectral import (
    ModelUncertainty,
    SnapshotCalibration,
    SnapshotModel,
    refine_from_photograph,
    self_calibration,
)
from optics.multispectral.self_calibration import PhotographFit, busiest_window
from optics.progress import Cancelled, Progress

BAYER = ("RG", "GB")
RESPONSE = np.array([[0.1, 0.8], [0.5, 0.15], [0.4, 0.05]])
SPECTRA = np.array([[0.2, 0.3], [0.8, 0.7], [0.1, 0.6], [0.5, 0.2], [0.4, 0.4]])
RADII, REACH, SIDE = (3.0, 5.0), 8, 40


def rings(order=0.2, scale=1.0, reach=REACH):
    return np.stack([ring_psf(scale * one, order, reach=reach) for one in RADII])


def squares(side=SIDE + 2 * REACH, seed=0):
    """Squares and a grain, whose spectra are typical ones."""
    rng = np.random.default_rng(seed)
    size = -(-side // 6)
    chosen = np.kron(rng.integers(len(SPECTRA), size=(size, size)), np.ones((6, 6), np.int64))
    shade = rng.uniform(0.6, 1.0, (size, size)).repeat(6, 0).repeat(6, 1)
    scene = np.moveaxis(SPECTRA[chosen] * shade[..., None], -1, 0)
    return np.ascontiguousarray(scene[:, :side, :side])


def photograph(psfs, noise=0.01, seed=0, scene=None):
    scene = squares() if scene is None else scene
    light = blurred_part(scene, psfs, (REACH, REACH), (SIDE, SIDE))
    raw = bayer_frame(light, RESPONSE) + np.random.default_rng(seed).normal(0, noise, (SIDE, SIDE))
    return build_mosaic_observation(
        raw.astype(np.float32), BAYER, rings(), response=RESPONSE, noise=noise
    )


def model() -> SnapshotModel:
    return SnapshotModel.create(rings(), RESPONSE, zeroth_order=0.2, neutral=rings(1.0))


def fit(observation, iterations=20) -> PhotographFit:
    coupling = BandCoupling.spectral(torch.from_numpy(SPECTRA))
    return PhotographFit(observation, model(), torch.ones(2).double(), coupling, iterations)


def hurry(monkeypatch, iterations) -> None:
    """Small scenes with little blur need few iterations."""
    monkeypatch.setattr(self_calibration, "_ITERATIONS", iterations)
    monkeypatch.setattr(self_calibration, "_RESPONSE_ITERATIONS", iterations)


def test_the_prediction_is_a_convolution_behind_the_mosaic():
    scene = squares()
    own, none = fit(photograph(rings(), noise=1e-3)), torch.zeros(model().layout.count).double()
    seen = own.observe(none)
    picture = torch.zeros(2, *seen.period_shape)
    start = [(n - len(scene[0])) // 2 for n in seen.period_shape]
    down, along = (slice(first, first + len(scene[0])) for first in start)
    picture[:, down, along] = torch.from_numpy(scene).float()
    wanted = bayer_frame(blurred_part(scene, rings(), (REACH, REACH), (SIDE, SIDE)), RESPONSE)
    np.testing.assert_allclose(own.predict(seen, picture), wanted, atol=1e-4)


def test_the_score_is_the_derivative_of_the_likelihood():
    """By differences of the weighted squares, for parameters away from nominal."""
    rng = np.random.default_rng(1)
    weights = rng.uniform(0, 1, (SIDE, SIDE)).astype(np.float32)
    own = fit(replace(photograph(rings()), weights=torch.from_numpy(weights)))
    count = own.model.layout.count
    at = 0.02 * torch.from_numpy(rng.standard_normal(count))
    seen = own.observe(at)
    picture = torch.from_numpy(rng.uniform(0, 1, (2, *seen.period_shape))).float()

    def likelihood(deviation) -> float:
        left = (seen.image - own.predict(own.observe(deviation), picture)).double()
        return float(-(left.square() * own.weights).sum() / (2 * own.noise**2))

    score = own.score(seen, picture, at)
    steps = 1e-3 * torch.eye(count, dtype=torch.float64)
    wanted = [(likelihood(at + one) - likelihood(at - one)) / 2e-3 for one in steps]
    np.testing.assert_allclose(score, wanted, atol=1e-3 * float(score.abs().max()))


def test_the_window_is_where_the_contrast_is():
    quiet = photograph(rings(), noise=0.0)
    image = torch.zeros_like(quiet.image)
    image[17:33, 8:26] = torch.from_numpy(np.random.default_rng(0).uniform(0, 1, (16, 18)))
    found = busiest_window(replace(quiet, image=image), 20)
    assert found.image.shape == (20, 20)
    assert float(found.image.sum()) == pytest.approx(float(image.sum()), rel=1e-6)
    np.testing.assert_array_equal(found.filters, quiet.filters[:, :20, :20])
    assert busiest_window(quiet, SIDE) is quiet


def test_a_photograph_refines_its_own_calibration(monkeypatch):
    """The zeroth order is 0.05 off."""
    hurry(monkeypatch, 20)
    seen, nominal = photograph(rings(0.25)), SnapshotCalibration.nominal(model())
    refined, restored = refine_from_photograph(seen, SPECTRA, nominal)
    for band in (0, 1):
        share = next(one for one in refined.parameters if one.name.endswith(f"band {band}"))
        assert share.value == pytest.approx(0.25, abs=0.02)
        assert share.lower <= 0.25 <= share.upper
        assert share.deviation < 0.035
    assert restored.image.shape == (2, SIDE, SIDE)
    assert refined.indeterminate
    assert "photograph" in refined.source


def test_a_certain_calibration_stays_as_it_was(monkeypatch):
    """A photograph says less than calibration frames have."""
    hurry(monkeypatch, 5)
    sure = ModelUncertainty(
        zeroth_order=1e-5, zeroth_order_of_band=1e-5, scale=1e-5, centre=1e-4, response=1e-4
    )
    prior = SnapshotCalibration.nominal(model(), sure)
    refined, _ = refine_from_photograph(photograph(rings(0.25)), SPECTRA, prior)
    assert float((refined.deviation / prior.covariance.diagonal().sqrt()).abs().max()) < 1


def test_dead_pixels_say_nothing():
    """Whatever they hold, the score is the same."""
    weights = torch.ones(SIDE, SIDE)
    weights[::5, ::7] = 0
    seen = replace(photograph(rings()), weights=weights, given_noise=0.01)
    other = replace(seen, image=torch.where(weights > 0, seen.image, 5.0))
    none = torch.zeros(model().layout.count, dtype=torch.float64)
    picture = torch.ones(2, *fit(seen).observe(none).period_shape)
    sound, dead = (fit(one).score(fit(seen).observe(none, one.image), picture, none)
                   for one in (seen, other))  # fmt: skip
    np.testing.assert_allclose(dead, sound * (fit(seen).noise / fit(other).noise) ** 2)


def test_refinement_can_be_cancelled():
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        refine_from_photograph(
            photograph(rings()), SPECTRA, SnapshotCalibration.nominal(model()), progress=progress
        )


def test_another_camera_is_refused():
    seen, nominal = photograph(rings()), SnapshotCalibration.nominal(model())
    with pytest.raises(ValueError, match="bands"):
        refine_from_photograph(replace(seen, filter_period=(4, 2)), SPECTRA, nominal)
    with pytest.raises(ValueError, match="spectra"):
        refine_from_photograph(seen, SPECTRA[:1], nominal)
