"""The speckle contrast that a record's report tells of a star: its own, without camera noise."""

from types import SimpleNamespace

import numpy as np
import pytest

from labapp.pictures.analysis import star_psf
from optics.metrics import speckle_contrast


def bracket(rng: np.random.Generator, light: np.ndarray):
    """Electrons per second, of one exposure of a second with read noise."""
    rate = rng.poisson(light) + 4 * rng.standard_normal(light.shape)
    return SimpleNamespace(rate=rate, variance=light + 16, wavelength=550e-9)


def test_a_reported_contrast_is_that_of_the_light(monkeypatch):
    rng = np.random.default_rng(2)
    y, x = np.mgrid[-40:40, -40:40]
    target = ((np.hypot(y, x) > 10) & (np.hypot(y, x) < 25)).astype(float)
    true = target * (1 + 0.05 * rng.standard_normal(target.shape))
    light = 900 * true + 2.0
    neutral = 9e5 * (np.hypot(y, x) < 1) + 2.0
    found = {"neutral": bracket(rng, neutral), "coded": bracket(rng, light)}
    monkeypatch.setattr(star_psf, "find_bracket", lambda brackets, star, name, *more: found[name])
    monkeypatch.setattr(star_psf, "star_filters", lambda *more: None)
    monkeypatch.setattr(star_psf, "_target_on_sensor", lambda *more: target)
    monkeypatch.setattr(star_psf, "_predict_recorded_star", lambda *more: None)
    record = SimpleNamespace(
        path="", camera=None, plan=SimpleNamespace(patterns={"coded": None, "neutral": None})
    )
    roles = SimpleNamespace(
        star="star", neutral="neutral", coded="coded", wavelength=0, grey=None, psf_window_px=80
    )
    report = star_psf.measure_psf(record, [], roles)
    assert speckle_contrast(report.modulated_psf, target) > 0.058
    assert report.contrast == pytest.approx(speckle_contrast(true, target), abs=0.004)
