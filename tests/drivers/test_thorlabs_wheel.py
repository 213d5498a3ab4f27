"""The Thorlabs wheel's driver, byte for byte and against its machine on a virtual clock."""

import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded import Bench

from drivers.errors import DeviceError
from drivers.interfaces import FilterWheel, Surroundings
from drivers.thorlabs_wheel import ThorlabsWheel
from simulator.clock import VirtualClock
from simulator.machines.machine import Reply
from simulator.machines.thorlabs_wheel import ThorlabsWheelMachine
from simulator.wire import plug_in

SIX = [[450, 10], [500, 10], [550, 10], [600, 10], [650, 10], [700, 10]]
IDN = b"THORLABS FW102C/FW212C Filter Wheel version 1.07"


@pytest.fixture
def plugged():
    benches = []

    def plug(**options):
        crossed = []
        machine = ThorlabsWheelMachine(on_slot=crossed.append, **options)
        benches.append(bench := Bench(machine))
        bench.crossed = crossed
        return bench

    yield plug
    for bench in benches:
        bench.close()


def wheel(bench, **options):
    return ThorlabsWheel(bench.surroundings, bench.url, options.pop("slots_nm", SIX), **options)


def asked(question, answer):
    """A question three times: the driver wants answers that agree."""
    return [(question + b"\r", question + b"\r" + answer + b"\r> ")] * 3


def test_opening_and_a_move_byte_for_byte(plugged):
    bench = plugged()
    with wheel(bench) as device:
        assert bench.said() == [
            (b"\r", b"\r\0\0Command error CMD_NOT_DEFINED\r> "),
            *asked(b"*idn?", IDN),
            *asked(b"pcount?", b"6"),
            *asked(b"speed?", b"1"),
            *asked(b"sensors?", b"1"),
            (b"sensors=0\r", b"sensors=0\r> "),
            *asked(b"sensors?", b"0"),
            *asked(b"trig?", b"0"),
        ]
        device.set_slot(3)
        assert bench.said() == [
            *asked(b"pos?", b"1"),
            (b"pos=3\r", b"pos=3\r> "),
            *asked(b"pos?", b"3"),
        ]
        device.save()
        assert bench.said() == [(b"save\r", b"save\r> ")]


def test_firmware_1_0_byte_for_byte(plugged):
    def after_a_line(talk):
        dummy = (b">\r", b">\rCommand error CMD_NOT_DEFINED\r> ")
        return [piece for said in talk for piece in (dummy, said)]

    bench = plugged(firmware="1.0")
    with wheel(bench) as device:
        assert bench.said() == [
            (b"\r", b"\r\0\0Command error CMD_NOT_DEFINED\r> "),
            (b"*idn?\r", b"*idn?\rCommand error CMD_NOT_DEFINED\r> "),
            *after_a_line(asked(b"*idn?", IDN[:-1])),
            *after_a_line(asked(b"trig?", b"0")),
        ]
        assert device.set_slot(2).actual == 2
        assert device.health() == {"firmware": "1.0", "slot": "2", "trig": "0"}


def test_it_has_all_that_a_wheel_has_and_says_who_it_is(plugged):
    with wheel(plugged()) as device:
        assert isinstance(device, FilterWheel)
        assert device.identity.model == "Thorlabs FW102C"
        assert not device.identity.simulated
        assert device.health() == {
            "firmware": "1.07", "slot": "1", "speed": "1", "sensors": "0", "trig": "0",
            "pcount": "6",
        }  # fmt: skip


def test_a_move_ends_when_the_wheel_stands(plugged):
    bench = plugged()
    with wheel(bench, settling_ms=100) as device:
        began = bench.clock.now()
        setting = device.set_slot(3)
        took = bench.clock.now() - began
        assert 2.0 < took < 2.2
        assert setting.ready_at == pytest.approx(bench.clock.now() + 0.1)
        assert device.slot == bench.machine.position == 3
        assert device.set_wavelength(700e-9).actual == 700e-9
        assert bench.machine.position == 6


def test_a_slot_that_leaks_does_not_cross_the_light(plugged):
    bench = plugged()
    with wheel(bench, avoid=[2]) as device:
        device.set_slot(3)
        assert bench.crossed == [6, 5, 4, 3]
        bench.crossed.clear()
        device.set_slot(1)
        assert bench.crossed == [4, 5, 6, 1]


def test_slow_and_triggering_if_wanted(plugged):
    bench = plugged()
    with wheel(bench, fast=False, sensors=True, trigger="output") as device:
        assert device.reply_time == pytest.approx(3 * 4 + 2)
        told = bench.machine.settings
        assert (told["speed"], told["sensors"], told["trig"]) == (0, 1, 1)


def test_left_it_is_parked_at_its_first_slot(plugged):
    bench = plugged()
    with wheel(bench) as device:
        device.set_slot(4)
    assert bench.machine.position == 1


def test_twelve_slots(plugged):
    bench = plugged(slots=12)
    many = [[400 + 20 * i, 10] for i in range(12)]
    with wheel(bench, slots_nm=many) as device:
        assert device.identity.model == "Thorlabs FW212C"
        device.set_slot(11)
        assert bench.crossed == [12, 11]


def test_another_number_of_slots_is_named(plugged):
    with (
        pytest.raises(DeviceError, match=r"12 slots, and slots_nm 6.*an entry for every slot"),
        wheel(plugged(slots=12)),
    ):
        pass


def test_a_stuck_wheel_is_named_with_the_slot_where_it_stands(plugged):
    bench = plugged()
    with wheel(bench) as device:
        bench.suffer("stuck")
        with pytest.raises(DeviceError, match="turn to slot 3: it stands at slot 1: it is stuck"):
            device.set_slot(3)
        bench.line.clear_faults()
        assert device.set_slot(3).actual == 3


def test_an_error_of_the_wheel_is_told_in_words(plugged):
    bench = plugged()
    with wheel(bench) as device:
        bench.suffer("error code")
        with pytest.raises(DeviceError, match=r"doesn't know the command \(CMD_NOT_DEFINED\)"):
            device.set_slot(3)


def test_settings_that_were_lost_by_power_are_set_again(plugged):
    bench = plugged()
    with wheel(bench) as device:
        bench.suffer("disconnect", seconds=5.0)
        with pytest.raises(DeviceError, match=r"port sim://bench.*Plug"):
            device.set_slot(2)
        bench.line.machine = bench.machine = ThorlabsWheelMachine(position=5)
        bench.clock.wait_until(bench.clock.now() + 6, lambda: False)
        assert device.slot == 5
        assert bench.machine.settings["sensors"] == 0


def test_another_wheel_at_its_port_is_named(plugged):
    bench = plugged()
    with wheel(bench) as device:
        bench.suffer("disconnect", seconds=5.0)
        with pytest.raises(DeviceError):
            device.set_slot(2)
        bench.line.machine = ThorlabsWheelMachine(firmware="1.04")
        bench.clock.wait_until(bench.clock.now() + 6, lambda: False)
        with pytest.raises(DeviceError, match=r"another wheel answers: firmware 1.04, not 1.07"):
            device.set_slot(2)
        assert device._firmware == "1.07"


def test_a_wheel_that_turns_when_it_is_opened_is_waited_for(plugged):
    bench = plugged()
    bench.line.send(b"\rpos=4\r", 0.0)
    bench.clock.wait_until(0.5, lambda: False)
    with wheel(bench) as device:
        assert device.slot == 4


def test_nobody_at_the_port_is_a_device_error_in_time(plugged):
    bench = plugged()
    bench.suffer("silence")
    with (
        pytest.raises(DeviceError, match=r"no reply within 1 s\. Check the cable"),
        wheel(bench) as device,
    ):
        pass
    device = wheel(bench)
    assert bench.clock.now() < device.reply_time + 1


def test_killed_a_move_ends(plugged):
    bench = plugged()
    slow = VirtualClock(speed=5)
    bench.surroundings = Surroundings(slow)
    plug_in("bench", bench.line, slow)
    with wheel(bench) as device:
        timer = threading.Timer(0.1, device.kill)
        timer.start()
        with pytest.raises(DeviceError):
            device.set_slot(4)
        assert slow.now() < 2.9
        timer.join()


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ({"port": ""}, "port is ''"),
        ({"port": 7}, "port is 7"),
        ({"fast": 1}, "fast is 1; give true or false"),
        ({"sensors": "no"}, "sensors is 'no'"),
        ({"baudrate": 19200}, "baudrate is 19200; the wheel has 115200 or 9600"),
        ({"baudrate": "9600"}, "baudrate is '9600'"),
        ({"trigger": "in"}, "trigger is 'in'; choose input or output"),
        ({"trigger": []}, "trigger is"),
        ({"slots_nm": SIX[:5]}, "slots_nm has 5 slots; give all 6 of a FW102C or 12"),
        ({"slots_nm": []}, "slots_nm is"),
        ({"avoid": [7]}, "avoid is"),
        ({"step_ms": 0}, "step_ms is 0"),
        ({"settling_ms": -1}, "settling_ms is -1"),
    ],
)
def test_bad_options_are_named(option, said):
    with pytest.raises(ValueError, match=said):
        ThorlabsWheel(Surroundings(VirtualClock()), **{"port": "x", "slots_nm": SIX, **option})


class Chatter:
    """A wheel that echoes, and says anything else."""

    own_faults = ()

    def __init__(self, says):
        self.says = says
        self.line = b""

    def feed(self, data, t):
        replies = [Reply(t, data)] if data else []
        if data == b"\r":
            replies.append(Reply(t + 0.001, self.says))
        return replies

    def set_fault(self, kind):
        pass


@settings(max_examples=30, deadline=None)
@given(st.binary(max_size=80).map(lambda noise: noise + b"> ") | st.binary(max_size=80))
def test_whatever_it_says_it_is_no_wheel(noise):
    bench = Bench(Chatter(noise))
    try:
        with pytest.raises(DeviceError), wheel(bench):
            pass
        assert bench.clock.now() < 10
    finally:
        bench.close()
