import contextlib
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usb_benches import COMMANDS, SEVEN, Bench, ask, recover

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Device, FilterWheel, Surroundings
from drivers.zwo_wheel import ZwoWheel
from simulator.machines.usb_wheels import ZwoWheelMachine
from simulator.wire.faults import WireFault

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "25"))

WHO = "03 7e 5a 02 04 00 00 00 00 00 00 00 00 00 00 00"
WHERE = "03 7e 5a 02 01 00 00 00 00 00 00 00 00 00 00 00"


def question(said):
    return ((0x21, 9, 0x0303, 0), bytes.fromhex(said), b"")


def answer(said):
    return ((0xA1, 1, 0x0301, 0), 17, bytes.fromhex(said))


def opened(bench, **options):
    return ZwoWheel(bench.surroundings, SEVEN, backend=bench.backend, **options)


def test_it_is_a_filter_wheel_that_says_who_it_is():
    with Bench(ZwoWheelMachine()) as bench, opened(bench) as wheel:
        assert isinstance(wheel, FilterWheel)
        for name in [n for n in vars(Device) if not n.startswith("_")]:
            assert hasattr(wheel, name), name
        assert not wheel.identity.simulated
        health = wheel.health()
        assert (health["name"], health["firmware"]) == ("EFW-S-0", "3.0.9")
        assert (health["slots"], health["slot"], health["status"]) == ("7", "1", "1")


def test_the_bytes_are_those_that_were_seen_on_a_real_wire():
    """Word for word as A. Fritzler wrote them down, of a wheel that goes from 2 to 3."""
    with Bench(ZwoWheelMachine(position=2, step=0.15)) as bench:
        wheel = opened(bench)
        wheel.__enter__()
        who = [question(WHO), answer("01 7e 5a 04 03 00 09 00 45 46 57 2d 53 2d 30 00")]
        at_2 = [question(WHERE), answer("01 7e 5a 01 01 00 02 02 02 07 00 00 00 00 30 00")]
        assert bench.sent == [*who * 2, *at_2 * 2]
        bench.sent.clear()
        wheel.set_slot(3)
        go = question("03 7e 5a 01 02 03 00 00 00 00 00 00 00 00 00 00")
        goes = [question(WHERE), answer("01 7e 5a 01 04 00 03 02 03 07 00 00 00 00 30 00")]
        at_3 = [question(WHERE), answer("01 7e 5a 01 01 00 03 03 03 07 00 00 00 00 30 00")]
        assert bench.sent == [*at_2 * 2, go, *goes * 2, *at_3 * 2]


def test_the_error_that_was_seen_on_a_real_wire_is_named():
    """From 1 to 7 at once: its controller gives up, and only its plug helps."""
    machine = ZwoWheelMachine(step=0.35)
    with Bench(machine) as bench, opened(bench, both_ways=True) as wheel:
        with pytest.raises(
            DeviceError, match=r"given up turning \(status 6, error 12\)\. .* pull its plug"
        ):
            wheel.set_slot(7)
        assert bench.sent[-1] == answer("01 7e 5a 01 06 0c 06 06 06 07 00 00 00 00 30 00")
        bench.plug.inject(WireFault("disconnect", at=bench.clock.now(), seconds=1))
        with pytest.raises(DeviceError, match="unplugged"):
            _ = wheel.slot
        bench.wait(1)
        assert wheel.slot == 6


def test_it_goes_forward_slot_by_slot_as_far_as_anybody_knows():
    seen = []
    machine = ZwoWheelMachine(step=0.1, on_slot=seen.append)
    with Bench(machine) as bench, opened(bench) as wheel:
        wheel.set_slot(7)
        assert seen == [2, 3, 4, 5, 6, 7]
        wheel.set_slot(2)
        assert seen[6:] == [1, 2]
    assert bench.place == 1


def test_one_that_turns_both_ways_takes_the_shorter_one():
    seen = []
    machine = ZwoWheelMachine(step=0.1, both_ways=True, on_slot=seen.append)
    with Bench(machine) as bench, opened(bench, both_ways=True, avoid=[7]) as wheel:
        wheel.set_slot(6)
        assert seen == [2, 3, 4, 5, 6]


def test_what_cannot_be_avoided_is_said():
    with Bench(ZwoWheelMachine()) as bench, opened(bench, avoid=[3]) as wheel:
        wheel.set_slot(2)
        with pytest.raises(DeviceError, match=r"slot 2 to slot 4 crosses \[3\]"):
            wheel.set_slot(4)
        with pytest.raises(DeviceError, match=r"slot 2 to slot 1 crosses \[3\]"):
            wheel.make_safe()
        wheel.set_slot(3)


def test_a_wheel_of_another_size_is_refused():
    with (
        Bench(ZwoWheelMachine(slots=5)) as bench,
        pytest.raises(DeviceError, match=r"the wheel has 5 slots, slots_nm names 7"),
    ):
        opened(bench).__enter__()


def test_a_stuck_wheel_is_named():
    with Bench(ZwoWheelMachine(max_steps=0)) as bench, opened(bench) as wheel:
        bench.plug.inject(WireFault("stuck"))
        with pytest.raises(DeviceError, match=r"turn to slot 3: it stands at slot 1 after 22 s"):
            wheel.set_slot(3)
        bench.plug.clear_faults()
        bench.plug.inject(WireFault("busy forever"))
        with pytest.raises(DeviceError, match=r"read the slot: it is still turning after 22 s"):
            _ = wheel.slot
        bench.plug.clear_faults()


def test_an_unplugged_wheel_is_named_within_a_second_and_works_again():
    with Bench(ZwoWheelMachine(step=1.0)) as bench, opened(bench) as wheel:
        bench.plug.inject(WireFault("disconnect", at=bench.clock.now() + 1.7, seconds=20))
        began = bench.clock.now()
        with pytest.raises(DeviceError, match=r"it was unplugged\. Plug it in again"):
            wheel.set_slot(4)
        assert bench.clock.now() - began < 1.7 + 1
        bench.wait(20)
        assert wheel.set_slot(4).actual == 4 == bench.place


@settings(max_examples=EXAMPLES, deadline=None)
@given(
    st.lists(
        st.binary(max_size=17) | st.binary(max_size=13).map(b"\x01\x7e\x5a".__add__), max_size=8
    ),
    st.sampled_from(sorted(COMMANDS)),
)
def test_answers_of_any_bytes_are_survived(answers, name):
    machine = ZwoWheelMachine(step=0.1, max_steps=0)
    with Bench(machine) as bench, opened(bench, step_ms=500) as wheel:
        left, control = list(answers), machine.control

        def strange(setup, data, t):
            answer, reports = control(setup, data, t)
            return left.pop(0) if left and setup.request_type & 0x80 else answer, reports

        machine.control = strange
        began = bench.clock.now()
        with contextlib.suppress(DeviceError):
            ask(wheel, name)
        assert bench.clock.now() - began <= wheel.reply_time + 1
        del left[:]
        recover(bench, wheel)


@pytest.mark.parametrize(
    "options",
    [{"serial": 5}, {"backend": "nonsense"}, {"both_ways": 1}, {"step_ms": 0}, {"avoid": [8]}],
)
def test_bad_options_are_named(options):
    (name,) = options
    with pytest.raises(ValueError, match=f"{name} is"):
        ZwoWheel(Surroundings(RealClock()), SEVEN, **options)


def test_killed_a_move_ends_and_another_driver_finds_the_wheel_free():
    with Bench(ZwoWheelMachine()) as bench:
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
