"""`labapp bracket`: what a person and a program are told of a chosen bracket."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from optics.camera import Sensor
from optics.hdr import Bracket, cramer_rao_variance


def test_a_given_range_is_chosen_for_without_a_picture(labapp, small, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "simulator.devices.SimulatedCamera.capture", lambda *_: pytest.fail("a frame was taken")
    )
    words = ["--snr-db", 30, "--electrons", "1e3,1e6", "--plot", tmp_path / "snr.png"]
    code, printed, said = labapp("bracket", *words, *small.arguments())
    assert (code, said) == (0, "")
    assert "30 dB from 1e+03 to 1e+06 electrons/s" in printed
    lines = [line.split() for line in printed.splitlines()]
    totals = {line[0]: line[1:] for line in lines if line and line[0] in ("chosen", "x2", "x4")}
    assert int(totals["chosen"][0]) == 3
    assert float(totals["chosen"][1]) <= float(totals["x2"][1])
    assert cv2.imread(str(tmp_path / "snr.png")).shape == (540, 960, 3)


def test_a_metered_bracket_as_data(labapp, small):
    """The exposures reach 26 dB over two decades by the bound of the merge."""
    words = ["--snr-db", 26, "--decades", 2, "--darks", 4, "--wavelength-nm", 550, "--json"]
    code, printed, said = labapp("bracket", *words, *small.arguments())
    assert (code, said) == (0, "")
    data = json.loads(printed)
    low, high = data["electrons_per_s"]
    assert high / low == pytest.approx(100)
    assert data["metered"][0]["target"] == "star"
    assert data["metering_seconds"] > 0
    times = np.array(data["exposures_ms"]) * 1e-3
    count = len(times)
    bracket = Bracket(np.full((count, 1, 1), 64.0), times, [64.0] * count, [4] * count, Sensor())
    ratios = [rate / np.sqrt(cramer_rao_variance(bracket, rate)) for rate in data["rates"]]
    assert 20 * np.log10(min(ratios)) >= 26 - 0.02
    np.testing.assert_allclose(data["snr_db"]["chosen"], 20 * np.log10(ratios), atol=0.3)
    assert {one["name"] for one in data["alternatives"]} == {"x2", "x4", "x8"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--electrons", "1e3"], "--electrons 1e3: give two rates"),
        (["--electrons", "2,1"], "lower rate first"),
        (["--electrons", "1,2", "--decades", 2], "either decades or electrons_per_s"),
        (["--least", "money"], "bracket: key 'least' is 'money'"),
        (["--decades", -1], "bracket: key 'decades' is -1"),
        (["--target", "sun"], "names 'sun', which this bench doesn't have"),
        (["--electrons", "1e3,1e6", "--most-frames", 1], "with 1 frame of at most 30000 ms"),
    ],
)
def test_a_wrong_option_is_named(labapp, small, words, message):
    code, printed, said = labapp("bracket", "--snr-db", 30, *words, *small.arguments())
    assert code == 1
    assert printed == ""
    assert message in said
