"""The Thorlabs wheel's machine, against its manual's commands and what real wheels do."""

import pytest

from simulator.machines.thorlabs_wheel import ThorlabsWheelMachine
from simulator.wire import SimulatedLine


class Terminal:
    """A person at a terminal: what is typed, and all that is seen in the time after."""

    def __init__(self, **options) -> None:
        self.seen = []
        self.machine = ThorlabsWheelMachine(on_slot=self.seen.append, **options)
        self.line = SimulatedLine(self.machine, baudrate=115200)
        self.now = 0.0

    def type(self, keys, seconds=0.1):
        self.line.send(keys, self.now)
        self.now += seconds
        return self.line.receive(self.now)


@pytest.fixture
def terminal():
    ready = Terminal()
    ready.type(b"\r")
    return ready


def test_the_first_command_after_power_on_is_an_error_with_nothing_before_it():
    terminal = Terminal()
    assert terminal.type(b"*idn?\r") == b"*idn?\r\0\0Command error CMD_NOT_DEFINED\r> "
    assert (
        terminal.type(b"*idn?\r") == b"*idn?\rTHORLABS FW102C/FW212C Filter Wheel version 1.07\r> "
    )


@pytest.mark.parametrize(
    ("typed", "seen"),
    [
        (b"\r", b"\r> "),
        (b"pos?\r", b"pos?\r1\r> "),
        (b"pcount?\r", b"pcount?\r6\r> "),
        (b"trig?\r", b"trig?\r0\r> "),
        (b"speed?\r", b"speed?\r1\r> "),
        (b"sensors?\r", b"sensors?\r1\r> "),
        (b"baud?\r", b"baud?\r1\r> "),
        (b"sensors=0\rsensors?\r", b"sensors=0\r> sensors?\r0\r> "),
        (b"trig=1\rtrig?\r", b"trig=1\r> trig?\r1\r> "),
        (b"pcount=12\rpos=12\r", b"pcount=12\r> pos=12\r"),
        (b"save\r", b"save\r> "),
        (b"pos=7\r", b"pos=7\rCommand error CMD_ARG_INVALID\r> "),
        (b"pos=0\r", b"pos=0\rCommand error CMD_ARG_INVALID\r> "),
        (b"speed=2\r", b"speed=2\rCommand error CMD_ARG_INVALID\r> "),
        (b"pcount=8\r", b"pcount=8\rCommand error CMD_ARG_INVALID\r> "),
        (b"POS?\r", b"POS?\rCommand error CMD_NOT_DEFINED\r> "),
        (b"pos=\r", b"pos=\rCommand error CMD_NOT_DEFINED\r> "),
    ],
)
def test_each_command_byte_for_byte(terminal, typed, seen):
    assert terminal.type(typed) == seen


def test_it_prompts_when_the_move_is_done(terminal):
    assert terminal.type(b"pos=3\r", 1.9) == b"pos=3\r"
    assert terminal.type(b"", 0.2) == b"> "
    assert terminal.type(b"pos?\r") == b"pos?\r3\r> "


def test_it_goes_the_shorter_way_and_each_slot_crosses_the_light(terminal):
    terminal.type(b"pos=5\r", 3.0)
    assert terminal.seen == [6, 5]
    terminal.type(b"pos=3\r", 3.0)
    assert terminal.seen == [6, 5, 4, 3]


def test_slowly_it_takes_twice_as_long(terminal):
    terminal.type(b"speed=0\r")
    assert terminal.type(b"pos=2\r", 1.9) == b"pos=2\r"
    assert terminal.type(b"", 0.2) == b"> "


def test_what_is_typed_while_it_turns_waits(terminal):
    assert terminal.type(b"pos=2\rpos?\r", 2.0) == b"pos=2\r> pos?\r2\r> "


def test_saved_is_what_was_set_then(terminal):
    terminal.type(b"sensors=0\rsave\rtrig=1\r")
    assert terminal.machine.saved_settings == {**terminal.machine.settings, "trig": 0}


def test_firmware_1_0_knows_less_and_wants_a_line_before_each_command():
    terminal = Terminal(firmware="1.0")
    terminal.type(b"\r")
    assert terminal.type(b"pos?\r") == b"pos?\rCommand error CMD_NOT_DEFINED\r> "
    assert terminal.type(b">\rpos?\r") == b">\rCommand error CMD_NOT_DEFINED\r> pos?\r1\r> "
    for unknown in (b"pcount?", b"speed?", b"sensors?"):
        terminal.type(b">\r")
        assert terminal.type(unknown + b"\r") == unknown + b"\rCommand error CMD_NOT_DEFINED\r> "


def test_stuck_it_prompts_and_stands_where_it_stood(terminal):
    terminal.machine.set_fault("stuck")
    assert terminal.type(b"pos=2\r", 1.1) == b"pos=2\r> "
    assert terminal.type(b"pos?\r") == b"pos?\r1\r> "
    assert terminal.seen == []


def test_busy_forever_it_never_prompts_until_it_is_mended(terminal):
    terminal.machine.set_fault("busy forever")
    assert terminal.type(b"pos=2\r", 100.0) == b"pos=2\r"
    terminal.machine.set_fault(None)
    assert terminal.type(b"\r") == b"> \r> "


@pytest.mark.parametrize("options", [{"slots": 8}, {"position": 7}, {"position": 0}])
def test_a_wheel_that_can_not_be_is_refused(options):
    with pytest.raises(ValueError, match=r"(the|a) wheel has"):
        ThorlabsWheelMachine(**options)
