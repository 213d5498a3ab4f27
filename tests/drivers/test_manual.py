import math

import pytest

from drivers.errors import DeviceError
from drivers.interfaces import Device, Setting, Surroundings, TargetChanger
from drivers.manual import ManualTargets


class Noon:
    """A clock that stands still."""

    def now(self):
        return 12.0

    def wait_until(self, time, cancelled):
        raise AssertionError("a person is waited for by whoever asks")


NOON = Surroundings(Noon())


def test_targets_placed_by_hand_have_all_that_a_changer_has():
    with ManualTargets(NOON, ["dark", "star"]) as targets:
        for protocol in (TargetChanger, Device):
            for name in [n for n in vars(protocol) if not n.startswith("_")]:
                assert hasattr(targets, name), name


def test_a_person_is_a_real_device():
    with ManualTargets(NOON, ["dark"]) as targets:
        assert targets.by_hand
        assert not targets.identity.simulated
        assert targets.identity.model == "targets placed by hand"
        assert targets.reply_time > 0


def test_what_is_placed_stands_when_the_hand_has_left_the_bench():
    with ManualTargets(NOON, ["dark", "star"], settling_ms=250.0) as targets:
        assert targets.names == ("dark", "star")
        assert targets.settling == 0.25
        assert targets.place("star") == Setting("star", "star", 12.25)
        assert targets.current_target == "star"


def test_nothing_else_can_be_placed():
    with ManualTargets(NOON, ["dark", "star"]) as targets:
        targets.place("star")
        with pytest.raises(
            DeviceError,
            match=r"by hand: place moon: no such target\. Choose one of dark, star",
        ):
            targets.place("moon")
        assert targets.current_target == "star"


def test_making_safe_moves_nothing():
    with ManualTargets(NOON, ["dark", "star"]) as targets:
        targets.place("star")
        targets.make_safe()
        targets.make_safe()
        assert targets.current_target == "star"


@pytest.mark.parametrize("names", ["star", [], (), [1], ["star", None]])
def test_names_that_are_none_are_refused(names):
    with pytest.raises(ValueError, match=r"names is .*; give a list of one name or more"):
        ManualTargets(NOON, names)


@pytest.mark.parametrize("settling", [-1.0, math.nan, math.inf, 1_000_001])
def test_a_settling_time_that_is_none_is_refused(settling):
    with pytest.raises(ValueError, match=r"settling_ms is .*; it must be from 0 to 1000000"):
        ManualTargets(NOON, ["star"], settling)


@pytest.mark.parametrize("settling", [0.0, 1_000_000])
def test_the_limits_of_the_settling_time_belong_to_it(settling):
    assert ManualTargets(NOON, ["star"], settling).settling == pytest.approx(settling / 1000)
