"""The method of a merge by its budget: what is counted, and what doesn't fit."""

import numpy as np
import pytest

from optics.accuracy import MachineSpeed
from optics.camera import Sensor
from optics.hdr import METHODS, Bracket, choose_method, merge_seconds


def bracket(shape=(400, 500), frames=4):
    times = 1e-3 * 2.0 ** np.arange(frames)
    return Bracket([np.zeros(shape)] * frames, times, [0.0] * frames, [1] * frames, Sensor())


def test_a_larger_budget_takes_a_better_method():
    seen, speed = bracket(), MachineSpeed()
    seconds = [merge_seconds(seen, one, speed) for one in METHODS]
    assert seconds == sorted(seconds)
    for name, spent in zip(METHODS[1:], seconds[1:], strict=True):
        assert choose_method(seen, 1.001 * spent, speed) == name
    assert choose_method(seen, 0.999 * seconds[-1], speed) == "Granados"
    # Three colours take three times as long.
    assert choose_method(seen, 1.001 * seconds[-1], speed, bands=3) != "full"


def test_time_grows_with_pixels_frames_and_a_slower_machine():
    few, many = bracket(), bracket((800, 500), 8)
    slow = MachineSpeed(touch=10 * MachineSpeed().touch, call=10 * MachineSpeed().call)
    for method in METHODS:
        first = merge_seconds(few, method, MachineSpeed())
        assert merge_seconds(many, method, MachineSpeed()) > 1.5 * first
        assert merge_seconds(few, method, slow) == pytest.approx(10 * first)


def test_what_does_not_fit_is_refused_with_the_least_time():
    with pytest.raises(ValueError, match=r"takes .* s at least, by the method (plain|Poisson)"):
        choose_method(bracket(), 1e-6)
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="give a positive number of seconds"):
            choose_method(bracket(), wrong)
