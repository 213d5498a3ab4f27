import itertools
import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Device, FilterWheel, Identity, Surroundings
from drivers.wheel import Wheel, parse_slots, plan_route, steps_between

HERE = Surroundings(RealClock())
FOUR = [[450, 10], [532, 10], [550, 20], [633, 5]]


def crossed(start: int, stops: Iterable[int], count: int) -> list[set[int]]:
    """What may cross the light, leg by leg, if the wheel takes the shorter way."""
    legs = []
    for stop in stops:
        ahead = (stop - start) % count
        between = set()
        if ahead <= count - ahead:
            between |= {(start - 1 + i) % count + 1 for i in range(1, ahead)}
        if ahead >= count - ahead:
            between |= {(start - 1 - i) % count + 1 for i in range(1, count - ahead)}
        legs.append(between)
        start = stop
    return legs


def test_a_wheel_turns_the_shorter_way_at_once():
    assert plan_route(2, 6, 6) == [6]
    assert plan_route(1, 4, 6) == [4]
    assert plan_route(3, 3, 6) == []


def test_a_way_around_an_open_slot_has_a_stop():
    # Of 12 openings 1 is empty: from 2 to 12 the short way crosses it.
    assert plan_route(2, 12, 12, [1]) == [7, 12]
    # Opposite slots: which way it goes nobody knows.
    assert plan_route(2, 8, 12, [1]) == [5, 8]
    assert plan_route(2, 5, 6, [1]) == [4, 5]
    assert plan_route(2, 6, 6, [1]) == [4, 6]


def test_what_cannot_be_avoided_is_said():
    with pytest.raises(ValueError, match=r"every way from slot 1 to slot 4 crosses \[3, 5\]"):
        plan_route(1, 4, 6, [3, 5])
    with pytest.raises(ValueError, match=r"slot 4 to slot 2 crosses \[5\]"):
        plan_route(4, 2, 6, [5], forward_only=True)


def test_a_wheel_that_only_turns_forward_goes_around():
    assert plan_route(1, 7, 7, forward_only=True) == [7]
    assert plan_route(6, 2, 7, max_leg=1, forward_only=True) == [7, 1, 2]


@pytest.mark.parametrize("slot", [0, 7, -1])
def test_slots_that_the_wheel_has_not_are_no_way(slot):
    with pytest.raises(ValueError, match=r"the wheel has 1 to 6"):
        plan_route(1, slot, 6)
    with pytest.raises(ValueError, match=r"the wheel has 1 to 6"):
        plan_route(slot, 1, 6)


@given(st.data())
def test_no_leg_of_a_route_crosses_what_is_avoided(data):
    count = data.draw(st.integers(1, 14))
    slot = st.integers(1, count)
    start, end, avoid = data.draw(slot), data.draw(slot), data.draw(st.sets(slot))
    longest = data.draw(st.integers(0, 3))
    free = [
        {(start - 1 + step * i) % count + 1 for i in range(1, (end - start) * step % count)}
        for step in (1, -1)
    ]
    try:
        stops = plan_route(start, end, count, avoid, max_leg=longest)
    except ValueError:
        assert all(way & avoid for way in free)
        return
    assert stops[-1:] == ([] if start == end else [end])
    assert len(set(stops)) == len(stops)
    assert not avoid & set(stops[:-1])
    for between in crossed(start, stops, count):
        assert not between & avoid
    if longest:
        places = [start, *stops]
        for one, two in itertools.pairwise(places):
            assert steps_between(one, two, count) <= longest


def test_slots_come_from_nanometres():
    one, two = parse_slots([[450, 10], (532.1234, 7.5)])
    assert (one.name, two.name) == ("450 nm", "532.123 nm")
    assert (one.wavelength, two.wavelength) == pytest.approx((450e-9, 532.123e-9), abs=1e-16)
    assert (one.bandwidth, two.bandwidth) == pytest.approx((10e-9, 7.5e-9))
    assert [slot.name for slot in parse_slots(FOUR, ["a", "b", "c", "d"])] == ["a", "b", "c", "d"]


@pytest.mark.parametrize(
    "slots",
    ["", [], "450", 7, [450], [[450]], [[450, 10, 1]], [[450, 0]], [[-1, 5]], [["450", 10]],
     [[math.nan, 10]], [[math.inf, 10]], [[True, 10]]],
)  # fmt: skip
def test_slots_that_are_none_are_refused(slots):
    with pytest.raises(ValueError, match="slots_nm"):
        parse_slots(slots)


@pytest.mark.parametrize("names", [["a"], "abcd", ["a", "a", "b", "c"], [1, 2, 3, 4], ["", *"abc"]])
def test_names_that_do_not_fit_are_refused(names):
    with pytest.raises(ValueError, match="names is"):
        parse_slots(FOUR, names)


class Obedient(Wheel):
    """A wheel without a wire."""

    model = "obedient wheel"

    def __init__(self, *given, **named):
        super().__init__(HERE, *given, **named)
        self.at, self.went, self.closed = 1, [], False

    @property
    def identity(self):
        return Identity(self.model, "", simulated=False)

    def _read_slot(self, command):
        return self.at

    def _turn_to(self, command, number):
        self.at = number
        self.went.append(number)

    def _close(self):
        self.closed = True


def test_a_wheel_is_a_filter_wheel_and_a_device():
    with Obedient(FOUR) as wheel:
        assert isinstance(wheel, FilterWheel)
        for name in [n for n in vars(Device) if not n.startswith("_")]:
            assert hasattr(wheel, name), name


def test_a_slot_is_chosen_by_wavelength_within_a_picometre():
    with Obedient(FOUR) as wheel:
        setting = wheel.set_wavelength(550.0004e-9)
        assert setting.actual == pytest.approx(550e-9, abs=1e-15)
        assert (wheel.slot, wheel.bandwidth) == (3, pytest.approx(20e-9))
        assert wheel.wavelength_range == pytest.approx((450e-9, 633e-9))
        with pytest.raises(
            DeviceError,
            match=r"tune to 551\.0 nm: no slot passes it\. Choose one of 450 nm, 532 nm, 550 nm",
        ):
            wheel.set_wavelength(551e-9)
        with pytest.raises(DeviceError):
            wheel.set_wavelength(math.nan)
    assert wheel.at == 1
    assert wheel.closed


def test_a_wheel_steers_around_what_it_must_avoid():
    with Obedient([[400 + 10 * i, 5] for i in range(6)], avoid=[1]) as wheel:
        wheel.at = 2
        wheel.set_slot(6)
        assert wheel.went == [4, 6]


def test_what_a_wheel_cannot_avoid_is_named():
    with Obedient(FOUR, avoid=[2, 4]) as wheel:
        with pytest.raises(DeviceError, match=r"turn to slot 3: every way .* take it out of avoid"):
            wheel.set_slot(3)
        with pytest.raises(DeviceError, match=r"no such slot\. Choose 1 to 4"):
            wheel.set_slot(5)


def test_its_reply_time_covers_its_longest_way():
    assert Obedient(FOUR, step_ms=1000).reply_time == pytest.approx(2 + 2)
    assert Obedient(FOUR, step_ms=1000, avoid=[1]).reply_time == pytest.approx(3 + 2)


@pytest.mark.parametrize(
    "options",
    [{"avoid": [0]}, {"avoid": [5]}, {"avoid": "1"}, {"avoid": [1.0]}, {"step_ms": 0},
     {"step_ms": math.nan}, {"settling_ms": -1}, {"settling_ms": math.inf}, {"avoid": 1},
     {"step_ms": "fast"}, {"step_ms": True}, {"settling_ms": [5]}, {"settling_ms": None}],
)  # fmt: skip
def test_bad_options_are_named(options):
    (name,) = options
    with pytest.raises(ValueError, match=f"{name} is"):
        Obedient(FOUR, **options)


def test_an_error_in_the_block_is_not_hidden_by_one_at_the_end():
    class Broken(Obedient):
        def _turn_to(self, command, number):
            raise self._refuse(command, "broken", "Mend it")

    wheel = Broken(FOUR)

    def block():
        with wheel:
            wheel.at = 2
            raise KeyError

    with pytest.raises(KeyError):
        block()
    assert wheel.closed
    wheel.at = 2
    with pytest.raises(DeviceError, match="broken"):
        wheel.__exit__(None, None, None)
