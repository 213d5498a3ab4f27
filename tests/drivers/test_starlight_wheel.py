import contextlib
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usb_benches import COMMANDS, SEVEN, Bench, ask, recover

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Device, FilterWheel, Surroundings
from drivers.starlight_wheel import StarlightWheel
from simulator.machines.usb_wheels import StarlightWheelMachine
from simulator.wire.faults import WireFault

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "25"))

SET = (0x21, 9, 0x0200, 0)


def question(*report):
    return (SET, bytes(report), b"")


def answer(*report):
    return (0x81, 2, bytes(report))


def opened(bench, **options):
    return StarlightWheel(bench.surroundings, SEVEN, backend=bench.backend, **options)


def test_it_is_a_filter_wheel_that_says_who_it_is():
    with (
        Bench(StarlightWheelMachine(serial="SX17")) as bench,
        opened(bench, serial="SX17") as wheel,
    ):
        assert isinstance(wheel, FilterWheel)
        for name in [n for n in vars(Device) if not n.startswith("_")]:
            assert hasattr(wheel, name), name
        assert wheel.identity.serial == "SX17"
        assert not wheel.identity.simulated
        assert wheel.health() == {
            "product": "SX Filter Wheel",
            "maker": "Starlight Xpress",
            "serial number": "SX17",
            "release": "1.00",
            "slots": "7",
            "slot": "1",
        }


def test_the_bytes_of_a_move_are_those_of_the_handbook():
    """Two steps of 0.1 s: the wheel says 0 while it turns, then where it stands, thrice."""
    with Bench(StarlightWheelMachine(step=0.1)) as bench:
        wheel = opened(bench)
        wheel.__enter__()
        here = [question(0, 0), answer(1, 7)]
        assert bench.sent == here * 3
        bench.sent.clear()
        wheel.set_slot(3)
        turning, there = [question(0, 0), answer(0, 7)], [question(0, 0), answer(3, 7)]
        assert bench.sent[:8] == [*here * 3, question(3, 0), answer(0, 7)]
        rest = bench.sent[8:]
        assert rest[-6:] == there * 3
        assert rest[:-6] == turning * (len(rest[:-6]) // 2)
        assert rest[:-6]


def test_it_has_the_wheel_count_its_filters_where_it_does_not_know():
    with (
        Bench(StarlightWheelMachine(slots_known=False, position=3, step=0.1)) as bench,
        opened(bench) as wheel,
    ):
        assert bench.sent[:4] == [question(0, 0), answer(3, 0), question(0, 1), answer(0, 0)]
        assert bench.sent[-2:] == [question(0, 0), answer(1, 7)]
        assert wheel.slot == 1


def test_while_it_counts_it_says_so():
    with Bench(StarlightWheelMachine(step=0.1)) as bench, opened(bench) as wheel:
        bench.machine.power_up(bench.clock.now())
        told = wheel.health()
        assert (told["slots"], told["slot"]) == ("not counted yet", "turning")


def test_counting_can_be_asked_for():
    with Bench(StarlightWheelMachine(step=0.1)) as bench, opened(bench, count_filters=True):
        assert bench.sent[:2] == [question(0, 1), answer(0, 0)]


def test_a_wheel_that_just_got_power_is_waited_for():
    machine = StarlightWheelMachine(position=5, step=1.9)
    machine.power_up(0.0)
    with Bench(machine) as bench, opened(bench) as wheel:
        assert bench.clock.now() > 10 * 1.9
        assert wheel.slot == 1
        assert question(0, 1) not in bench.sent


def test_the_light_sees_each_slot_that_crosses_it_but_none_to_be_avoided():
    seen = []
    machine = StarlightWheelMachine(step=0.1, on_slot=seen.append)
    with Bench(machine) as bench, opened(bench, avoid=[1]) as wheel:
        wheel.set_slot(2)
        del seen[:]
        wheel.set_slot(7)
        assert seen == [3, 4, 5, 6, 7]
        wheel.set_slot(1)


def test_a_wheel_of_another_size_is_refused():
    with (
        Bench(StarlightWheelMachine(slots=5)) as bench,
        pytest.raises(DeviceError, match="the wheel has 5 slots, slots_nm names 7"),
    ):
        opened(bench).__enter__()


def test_a_stuck_wheel_is_named():
    with Bench(StarlightWheelMachine()) as bench, opened(bench) as wheel:
        bench.plug.inject(WireFault("stuck"))
        with pytest.raises(DeviceError, match=r"turn to slot 3: it stands at slot 1 after 10 s"):
            wheel.set_slot(3)
        bench.plug.clear_faults()
        bench.plug.inject(WireFault("busy forever"))
        with pytest.raises(DeviceError, match=r"read the slot: it is still turning after 10 s"):
            _ = wheel.slot
        bench.plug.clear_faults()


def test_an_unplugged_wheel_is_named_within_a_second_and_works_again():
    with Bench(StarlightWheelMachine(step=1.0, serial="A")) as bench, opened(bench) as wheel:
        bench.plug.inject(WireFault("disconnect", at=bench.clock.now() + 1.7, seconds=20))
        began = bench.clock.now()
        with pytest.raises(DeviceError, match=r"it was unplugged\. Plug it in again"):
            wheel.set_slot(4)
        assert bench.clock.now() - began < 1.7 + 1
        with pytest.raises(DeviceError, match="no USB device 1278:0920 is there"):
            _ = wheel.slot
        bench.wait(20)
        assert wheel.slot == 1
        assert wheel.set_slot(4).actual == 4


def test_another_wheel_in_its_place_is_refused():
    with Bench(StarlightWheelMachine(serial="A")) as bench, opened(bench) as wheel:
        bench.plug.inject(WireFault("disconnect", at=bench.clock.now(), seconds=5))
        with pytest.raises(DeviceError, match="unplugged"):
            _ = wheel.slot
        bench.plug.machine = StarlightWheelMachine(serial="B")
        bench.wait(6)
        with pytest.raises(DeviceError, match=r"another device .*number B.* where .*number A"):
            _ = wheel.slot
        bench.plug.machine = bench.machine


def test_late_answers_are_not_taken_for_the_next_ones():
    """Each answer comes 1.5 s after its question: after the time-out, when the next is asked."""
    with Bench(StarlightWheelMachine(step=0.1)) as bench, opened(bench) as wheel:
        bench.plug.inject(WireFault("delayed", delay=1.5))
        for _ in range(4):
            with pytest.raises(DeviceError, match=r"no answer within 1 s"):
                wheel.set_slot(5)
        bench.plug.clear_faults()
        assert wheel.set_slot(2).actual == 2 == bench.place


@settings(max_examples=EXAMPLES, deadline=None)
@given(st.lists(st.binary(max_size=4), max_size=8), st.sampled_from(sorted(COMMANDS)))
def test_answers_of_any_bytes_are_survived(answers, name):
    with Bench(StarlightWheelMachine(step=0.1)) as bench, opened(bench, step_ms=200) as wheel:
        left, out = list(answers), bench.machine.write

        def strange(endpoint, data, t):
            reports = out(endpoint, data, t)
            return [report._replace(data=left.pop(0)) if left else report for report in reports]

        bench.machine.write = strange
        began = bench.clock.now()
        with contextlib.suppress(DeviceError):
            ask(wheel, name)
        assert bench.clock.now() - began <= wheel.reply_time + 1
        del left[:]
        recover(bench, wheel)


@pytest.mark.parametrize(
    "options",
    [{"serial": 5}, {"backend": "nonsense"}, {"backend": 3}, {"count_filters": 1},
     {"step_ms": 0}, {"avoid": [8]}, {"settling_ms": -1}],
)  # fmt: skip
def test_bad_options_are_named(options):
    (name,) = options
    with pytest.raises(ValueError, match=f"{name} is"):
        StarlightWheel(Surroundings(RealClock()), SEVEN, **options)


def test_it_touches_nothing_before_it_is_entered():
    StarlightWheel(Surroundings(RealClock()), SEVEN, backend="simulated-here@nothing")


def test_killed_a_move_ends_and_another_driver_finds_the_wheel_free():
    with Bench(StarlightWheelMachine()) as bench:
        wheel = opened(bench)
        wheel.__enter__()
        began = bench.clock.now()
        wait = bench.clock.wait_until

        def wait_until(time, cancelled):
            if bench.clock.now() > began + 0.3:
                wheel.kill()
            wait(time, cancelled)

        bench.clock.wait_until = wait_until
        with pytest.raises(DeviceError, match="turn to slot 4: the device was given up"):
            wheel.set_slot(4)
        assert bench.clock.now() < began + 0.6
        assert bench.plug.kernel_driver
        bench.clock.wait_until = wait
        with opened(bench) as again:
            assert again.slot == bench.place
