"""The cable: its pace, its order and its faults."""

from __future__ import annotations

import math

import pytest

from simulator.machines.machine import Reply
from simulator.wire import WIRE_FAULT_KINDS, SimulatedLine, WireFault


class Parrot:
    """Echoes each byte at once, and says a line again 0.1 s after its CR."""

    own_faults = ("tired",)

    def __init__(self) -> None:
        self.heard: list[tuple[bytes, float]] = []
        self.line = b""
        self.tired = False

    def feed(self, data: bytes, t: float) -> list[Reply]:
        self.heard.append((data, t))
        if self.tired:
            return []
        if not data:
            said, self.line = self.line, b""
            return [Reply(t, said)]
        self.line += data
        due = [Reply(t + 0.1, b"")] if data == b"\r" else []
        return [Reply(t, data), *due]

    def set_fault(self, kind: str | None) -> None:
        self.tired = kind == "tired"


def talk(
    line: SimulatedLine, data: bytes = b"hello\r", at: float = 0.0, until: float = 1.0
) -> bytes:
    line.send(data, at)
    return line.receive(until)


def test_a_byte_takes_ten_bits_in_each_direction():
    parrot = Parrot()
    line = SimulatedLine(parrot, baudrate=9600)
    line.send(b"ab", 1.0)
    assert line.receive(1.0) == b""
    assert line.next_event_time() == pytest.approx(1.0 + 10 / 9600)
    assert line.receive(1.0 + 19.9 / 9600) == b""
    assert line.receive(1.0 + 20.1 / 9600) == b"a"
    assert line.receive(1.0 + 30.1 / 9600) == b"b"
    assert [t for _, t in parrot.heard] == pytest.approx([1 + 10 / 9600, 1 + 20 / 9600])
    assert line.next_event_time() == math.inf


def test_an_appointment_is_kept():
    line = SimulatedLine(Parrot(), baudrate=9600)
    line.send(b"hi\r", 0.0)
    assert line.receive(0.1) == b"hi\r"
    assert line.receive(0.2) == b"hi\r"


@pytest.mark.parametrize(
    ("kind", "came"),
    [
        ("silence", b""),
        ("mute", b""),
        ("duplicated", b"hello\rhello\rhello\r"),
        ("byte by byte", b"hello\rhello\r"),
        ("wrong echo", b"idmmn\x0chello\r"),
        ("disconnect", b""),
        ("tired", b""),
    ],
)
def test_what_a_fault_leaves(kind, came):
    line = SimulatedLine(Parrot(), baudrate=9600)
    line.inject(WireFault(kind))
    assert talk(line) == came
    line.clear_faults()
    assert talk(line, b"x\r", 5.0, 6.0)[-2:] == b"x\r"


def test_silence_hears_nothing_and_mute_does():
    for kind, heard in (("silence", 0), ("mute", 7)):
        parrot = Parrot()
        line = SimulatedLine(parrot, baudrate=9600)
        line.inject(WireFault(kind))
        talk(line)
        assert len(parrot.heard) == heard


def test_an_answer_is_cut_short():
    for seed in range(20):
        line = SimulatedLine(Parrot(), baudrate=9600, seed=seed)
        line.inject(WireFault("truncated"))
        came = talk(line)
        assert b"hello\rhello\r".startswith(came)
        assert 6 <= len(came) < 12


def test_an_answer_is_garbage():
    came = set()
    for seed in range(20):
        line = SimulatedLine(Parrot(), baudrate=9600, seed=seed)
        line.inject(WireFault("garbage"))
        came.add(talk(line))
    assert len(came) > 15
    assert all(one.startswith(b"hello\r") and len(one) > 6 for one in came)


def test_an_answer_comes_late_and_others_overtake_it():
    line = SimulatedLine(Parrot(), baudrate=9600)
    line.inject(WireFault("delayed", seconds=0.5, delay=2.0))
    assert talk(line) == b"hello\r"
    line.clear_faults()
    assert talk(line, b"x\r", 1.0, 1.9) == b"x\rx\r"
    assert line.receive(2.0) == b""
    assert line.receive(2.2) == b"hello\r"


def test_noise_strikes_both_directions_as_often_as_it_says():
    parrot = Parrot()
    line = SimulatedLine(parrot, baudrate=115200)
    line.inject(WireFault("bit flips", share=0.1))
    sent = b"a" * 5000
    came = talk(line, sent)
    heard = b"".join(data for data, _ in parrot.heard)
    assert sum(byte != ord("a") for byte in heard) == pytest.approx(500, abs=80)
    there_and_back = 5000 * (1 - 0.9**2)
    assert sum(byte != ord("a") for byte in came) == pytest.approx(there_and_back, abs=130)


def test_byte_by_byte_takes_its_time():
    line = SimulatedLine(Parrot(), baudrate=9600)
    line.inject(WireFault("byte by byte"))
    assert len(talk(line, b"hello\r", until=0.1)) == 4
    assert line.receive(1.0)


def test_a_fault_lasts_as_long_as_it_does():
    line = SimulatedLine(Parrot(), baudrate=9600)
    line.inject(WireFault("mute", at=1.0, seconds=1.0))
    assert talk(line, b"a", 0.5, 0.9) == b"a"
    assert talk(line, b"b", 1.5, 1.9) == b""
    assert talk(line, b"c", 2.5, 2.9) == b"c"


def test_pulls_are_counted_even_once_they_are_mended():
    line = SimulatedLine(Parrot(), baudrate=9600)
    line.inject(WireFault("disconnect", at=1.0, seconds=1.0))
    assert (line.unplug_count(0.5), line.next_unplug_time(0.5)) == (0, 1.0)
    assert not line.is_unplugged(0.5)
    assert line.is_unplugged(1.5)
    assert line.unplug_count(1.5) == 1
    line.receive(2.5)
    line.clear_faults()
    assert line.unplug_count(2.5) == 1


def test_bad_options_are_named():
    with pytest.raises(ValueError, match="baudrate is 0"):
        SimulatedLine(Parrot(), baudrate=0)
    with pytest.raises(ValueError, match="kind is 'gremlin'; choose one of silence"):
        SimulatedLine(Parrot(), baudrate=9600).inject(WireFault("gremlin"))
    for bad in ({"at": math.nan}, {"seconds": -1.0}, {"delay": math.inf}, {"share": 2.0}):
        with pytest.raises(ValueError, match="must be"):
            WireFault("mute", **bad)


def test_every_kind_of_the_wire_can_be_injected():
    for kind in WIRE_FAULT_KINDS:
        line = SimulatedLine(Parrot(), baudrate=9600)
        line.inject(WireFault(kind))
        talk(line)
