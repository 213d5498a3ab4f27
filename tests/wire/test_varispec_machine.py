"""The VariSpec's machine, against the examples and tables of the user manual 1.37."""

from __future__ import annotations

import pytest

from simulator.machines.varispec import VariSpecMachine
from simulator.wire import SimulatedLine


class Bench:
    """A person at a terminal: what is typed, and all that is seen until it is quiet."""

    def __init__(self, **options) -> None:
        self.tuned: list[float] = []
        self.machine = VariSpecMachine(on_tuned=self.tuned.append, **options)
        self.line = SimulatedLine(self.machine, baudrate=9600)
        self.now = 0.0

    def type(self, keys: bytes, seconds: float = 1.0) -> bytes:
        self.line.send(keys, self.now)
        self.now += seconds
        return self.line.receive(self.now)


@pytest.fixture
def bench():
    return Bench()


def test_tuning_by_wavelength_as_in_example_1(bench):
    assert bench.type(b"W ?\r") == b"W ?\rW 550.00\r"
    assert bench.type(b"W 500\r") == b"W 500\r"
    assert bench.type(b"W 600\r") == b"W 600\r"
    assert bench.type(b"W    488\r") == b"W    488\r"
    assert bench.type(b"W 900\r") == b"W 900\r"
    assert bench.type(b"@") == b"@" + bytes([0b01100011])
    assert bench.type(b"W ?\r") == b"W ?\rW 488.00\r"
    assert bench.type(b"R ?\r") == b"R ?\rR    12\r"
    assert bench.type(b"R 1\r") == b"R 1\r"
    assert bench.type(b"@") == b"@C"
    assert bench.type(b"R ?\r") == b"R ?\rR     0\r"
    assert bench.tuned == [550e-9, 500e-9, 600e-9, 488e-9]


def test_tuning_with_a_palette_as_in_example_2(bench):
    bench.type(b"D 460\rD 540\rD 640\r")
    assert bench.type(b"D ?\r") == b"D ?\rD     3\rD 460.00\rD 540.00\rD 640.00\r"
    assert bench.type(b"@") == b"@G"
    assert bench.type(b"P 0\rW ?\r").endswith(b"W 460.00\r")
    assert bench.type(b"P 2\rW ?\r").endswith(b"W 640.00\r")
    assert bench.type(b"D 550 1\rW ?\r").endswith(b"W 640.00\r")
    assert bench.type(b"P 1\rW ?\r").endswith(b"W 550.00\r")
    bench.type(b"D -1,0\r")
    assert bench.type(b"D ?\r") == b"D ?\rD     2\rD 550.00\rD 640.00\r"
    bench.type(b"P >\r")
    assert bench.type(b"P ?\r") == b"P ?\rp     0\r"
    bench.type(b"C 1\r")
    assert bench.type(b"D ?\r") == b"D ?\rD     0\r"
    assert bench.type(b"P ?\r") == b"P ?\rp   255\r"


def test_sync_pulses_as_in_example_3(bench):
    bench.type(b"D 460\rD 540\rD 640\rM 0\rG 1\r")
    for element, wavelength in ((0, 460), (1, 540), (2, 640), (0, 460)):
        bench.type(b"X 1\r")
        assert bench.type(b"P ?\r").endswith(b"p %5d\r" % element)
        assert bench.tuned[-1] == pytest.approx(wavelength * 1e-9)
    bench.type(b"M 4\rJ -10\rX 1\r")
    assert bench.type(b"W ?\r").endswith(b"W 450.00\r")
    bench.type(b"W >\r")
    assert bench.type(b"W ?\r").endswith(b"W 440.00\r")


def test_who_it_is():
    bench = Bench(firmware="141", serial=507, range_nm=(400.0, 1050.5))
    assert bench.type(b"V ?\r") == b"V ?\rv   141  400.00  1050.50 00507\r"


def test_brief_and_confirming_replies(bench):
    bench.type(b"B 1\r")
    assert bench.type(b"B ?\r") == b"B ?\r1\r"
    assert bench.type(b"W ?\r") == b"W ?\r550.00\r"
    assert bench.type(b"@") == b"@K"
    bench.type(b"B 2\r")
    assert bench.type(b"W 600\r") == b"W 600\rW 600.00\r"
    assert bench.type(b"W 900\r") == b"W 900\r"
    bench.type(b"B 0\r")
    assert bench.type(b"W 600\r") == b"W 600\r"


@pytest.mark.parametrize(
    ("typed", "code"),
    [
        (b"Q 1\r", 1),
        (b"W five\r", 1),
        (b"\xff\r", 1),
        (b"V 1\r", 2),
        (b"Y 20\r", 2),
        (b"E 256\r", 3),
        (b"I 2\r", 5),
        (b"M 2\r", 7),
        (b"P 0\r", 9),
        (b"D 500\rP 1\r", 11),
        (b"D 500,2\r", 11),
        (b"W 399.99\r", 12),
        (b"D 800\r", 12),
        (b"J 400\r", 14),
        (b"G 256\r", 17),
    ],
)
def test_error_codes_as_in_table_4(bench, typed, code):
    assert bench.type(typed) == typed
    assert bench.type(b"R ?\r") == b"R ?\rR %5d\r" % code


def test_a_filter_that_is_not_initialised():
    bench = Bench(initialises=False)
    assert bench.type(b"@") == b"@@"
    assert bench.type(b"I ?\r") == b"I ?\rI     0\r"
    assert bench.type(b"W ?\r") == b"W ?\rW*\r"
    bench.type(b"W 500\r")
    assert bench.type(b"R ?\r") == b"R ?\rR     4\r"
    bench.type(b"R 1\r")
    assert bench.type(b"I 1\r") == b"I 1\r"
    assert bench.type(b"!") == b"!<"
    assert bench.type(b"W 500\rW ?\r", 20.0) == b"W 500\rW ?\r"
    assert bench.type(b"!", 7.9) == b"!<"
    assert bench.type(b"") == b"W 500.00\r"
    assert bench.type(b"!") == b"!>"
    assert bench.type(b"@") == b"@C"


def test_power_up_and_exercise_take_their_time():
    bench = Bench(powered_at=0.0)
    assert bench.type(b"!", 29.9) == b"!<"
    assert bench.type(b"!", 0.2) == b"!<"
    assert bench.type(b"!") == b"!>"
    bench.type(b"E 2\r", 23.9)
    assert bench.type(b"!", 0.2) == b"!<"
    assert bench.type(b"!") == b"!>"


def test_escape_aborts_within_20_ms_and_forgets_what_waits(bench):
    bench.type(b"I 1\rW 500\r")
    assert bench.type(b"\x1b!", 0.006) == b"\x1b!<"
    bench.now += 0.02
    assert bench.type(b"!") == b"!>"
    assert bench.type(b"I ?\r") == b"I ?\rI     0\r"
    assert bench.type(b"W 5\x1bW ?\r").endswith(b"W ?\rW*\r")


def test_rs232_electronics_calculate_for_300_ms():
    bench = Bench(electronics="rs232")
    assert bench.type(b"D 500\r", 0.2) == b"D 500\r"
    assert bench.type(b"!", 0.05) == b"!<"
    assert bench.type(b"!", 0.1) == b"!<"
    assert bench.type(b"!") == b"!>"
    bench.type(b"P 0\r", 0.02)
    assert bench.type(b"!", 0.02) == b"!>"


def test_a_sleeping_filter_echoes_and_does_nothing(bench):
    bench.type(b"S 11111\r")
    assert bench.type(b"@") == b"@C"
    bench.type(b"S 50527\r")
    assert bench.type(b"@") == b"@"
    assert bench.type(b"!") == b"!"
    assert bench.type(b"W 600\rW ?\r") == b"W 600\rW ?\r"
    bench.type(b"A 50527\r")
    assert bench.type(b"W ?\r") == b"W ?\rW 550.00\r"


def test_the_buffer_holds_256_characters(bench):
    bench.type(b"I 1\r")
    bench.type(b"W ?\r" * 100, 1.0)
    assert bench.type(b"", 40.0) == b"W 550.00\r" * 85


def test_own_faults(bench):
    bench.machine.set_fault("busy forever")
    assert bench.type(b"W ?\r", 100.0) == b"W ?\r"
    assert bench.type(b"!") == b"!<"
    bench.machine.set_fault(None)
    assert bench.type(b"\x1b") == b"\x1b"
    assert bench.type(b"W ?\r") == b"W ?\rW 550.00\r"
    bench.machine.set_fault("error code")
    bench.type(b"W 500\r")
    assert bench.type(b"R ?\r") == b"R ?\rR     8\r"
    bench.machine.set_fault(None)
    bench.machine.set_fault("uninitialised")
    assert bench.type(b"@")[1] & 1 == 0
    assert bench.type(b"W ?\r") == b"W ?\rW*\r"
    bench.machine.set_fault(None)
    assert bench.type(b"W ?\r") == b"W ?\rW 550.00\r"


def test_it_warms_up():
    bench = Bench()
    cold = float(bench.type(b"Y ?\r")[5:])
    bench.now += 3600.0
    warm = float(bench.type(b"Y ?\r")[5:])
    assert 20 < cold < cold + 3 < warm < 30
