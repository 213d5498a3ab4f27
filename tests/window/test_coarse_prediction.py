"""Predictions of the engine: of large sensors, as long as they are wanted, in digital numbers."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from labapp.window.engine import coarse_prediction
from labapp.window.engine.coarse_prediction import CoarsePrediction
from labapp.window.messages import LiveFrame
from optics.camera import Sensor

_LARGE = Sensor(
    shape=(400, 400), bits=12, full_well=10_000, gain=2.5, read_noise=2.0, black_level=64.0
)
_LABELS = LiveFrame(np.empty((0, 0), np.uint16), "star", "neutral", 550e-9, 0.1, 0)


class Pictures:
    """Coarse pictures that are known: electrons on squares of four pixels."""

    electrons = torch.full((100, 100), 1000.0)

    def predict(self, s, check):
        check()
        return self.electrons


@pytest.fixture
def predict(monkeypatch):
    monkeypatch.setattr(coarse_prediction, "CoarsePictures", Pictures)
    shown = []

    def run(sensor=_LARGE, planned=False, wanted=True):
        situation = SimpleNamespace(camera=SimpleNamespace(sensor=sensor))
        world = SimpleNamespace(
            situation=lambda exposure: situation,
            imaging=SimpleNamespace(is_planned=lambda s: planned),
        )
        prediction = CoarsePrediction(world, lambda frame, is_wanted: shown.append(frame))
        prediction.begin(_LABELS, lambda: wanted)
        time.sleep(0.05)
        prediction.close()
        return shown

    return run


def test_electrons_become_digital_numbers_of_the_whole_frame(predict):
    (frame,) = predict()
    assert frame.image.dtype == np.uint16
    assert frame.image.shape == (400, 400)
    # 1000 electrons at 2.5 electrons per DN, above a black level of 64 DN.
    assert (frame.image == 464).all()
    assert frame.target == "star"


def test_a_full_well_holds_no_more(predict, monkeypatch):
    monkeypatch.setattr(Pictures, "electrons", torch.full((100, 100), 1e7))
    (frame,) = predict()
    assert (frame.image == min(4095, 64 + 10_000 / 2.5)).all()


@pytest.mark.parametrize(
    "case",
    [{"wanted": False}, {"planned": True}, {"sensor": replace(_LARGE, shape=(64, 96))}],
)
def test_nothing_is_predicted_where_it_helps_nobody(predict, case):
    assert predict(**case) == []


def test_a_prediction_that_fails_only_leaves_a_warning(predict, monkeypatch, caplog):
    def fail(self, s, check):
        raise ValueError("no such picture")

    monkeypatch.setattr(Pictures, "predict", fail)
    assert predict() == []
    assert "no coarse prediction" in caplog.text
