"""The VariSpec's driver, byte for byte and against its machine on a virtual clock."""

from __future__ import annotations

import contextlib
import math
import subprocess
import sys
import threading

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import SpectralFilter, Surroundings
from drivers.supervised import SupervisedDevice
from drivers.varispec import VariSpec
from drivers.varispec.settling import settling_factor
from simulator.clock import VirtualClock
from simulator.machines.machine import Reply
from simulator.machines.varispec import VariSpecMachine
from simulator.wire import SimulatedLine, WireFault, plug_in, unplug
from simulator.wire.pty import PtyLine


class Recorded(SimulatedLine):
    """A line that writes down what the host sends and what it is given."""

    def __init__(self, machine, **options) -> None:
        super().__init__(machine, **options)
        self.sent = bytearray()
        self.received = bytearray()

    def send(self, data: bytes, t: float) -> None:
        self.sent += data
        super().send(data, t)

    def receive(self, t: float) -> bytes:
        data = super().receive(t)
        self.received += data
        return data

    def since(self) -> tuple[bytes, bytes]:
        said = bytes(self.sent), bytes(self.received)
        self.sent.clear()
        self.received.clear()
        return said


class Bench:
    """A machine on a line at sim://varispec, on a virtual clock."""

    def __init__(self, machine=None, baudrate=9600, **options) -> None:
        self.clock = VirtualClock()
        self.machine = machine or VariSpecMachine(**options)
        self.line = Recorded(self.machine, baudrate=baudrate)
        self.url = plug_in("varispec", self.line, self.clock)

    def filter(self, **options) -> VariSpec:
        return VariSpec(Surroundings(self.clock), port=self.url, **options)

    def later(self, seconds: float) -> None:
        self.clock.wait_until(self.clock.now() + seconds, lambda: False)


@pytest.fixture(autouse=True)
def unplugged():
    yield
    unplug("varispec")


# What the manual's formats make of a session with number 50527, 400 to 720 nm, at 25 degrees.
_OPENING = [
    (b"!", b"!>"),
    (b"!", b"!>"),
    (b"\x1b", b"\x1b"),
    *[(b"@", b"@C")] * 3,
    *[(b"!", b"!>")] * 2,
    (b"B 0\r", b"B 0\r"),
    (b"G 0\r", b"G 0\r"),
    (b"R 1\r", b"R 1\r"),
    (b"R ?\r", b"R ?\rR     0\r"),
    *[(b"V ?\r", b"V ?\rv   141  400.00  720.00 50527\r")] * 3,
    *[(b"@", b"@C")] * 3,
    *[(b"Y ?\r", b"Y ?\rY  25.00\r")] * 3,
    *[(b"W ?\r", b"W ?\rW 550.00\r")] * 4,
]
_TO_633 = [
    (b"W 633.00\r", b"W 633.00\r"),
    (b"R ?\r", b"R ?\rR     0\r"),
    (b"W ?\r", b"W ?\rW 633.00\r"),
]


def joined(talk):
    return b"".join(sent for sent, _ in talk), b"".join(came for _, came in talk)


class Scripted:
    """Answers exactly what a script says to exactly what it says is asked."""

    own_faults = ()

    def __init__(self, talk) -> None:
        self.left = list(talk)
        self.heard = b""

    def feed(self, data, t):
        if not data:
            return []
        self.heard += data
        asked, answer = self.left[0]
        assert asked.startswith(self.heard), (asked, self.heard)
        if self.heard != asked:
            return []
        self.heard = b""
        self.left.pop(0)
        return [Reply(t, answer)]

    def set_fault(self, kind):
        pass


def test_the_driver_says_what_the_manual_says_and_reads_what_it_answers():
    scripted = Scripted([*_OPENING, *_TO_633])
    bench = Bench(scripted)
    device = bench.filter().__enter__()
    assert device.identity.serial == "50527"
    assert device.wavelength_range == (400e-9, 720e-9)
    assert device.set_wavelength(633e-9).actual == 633e-9
    assert not scripted.left
    device.kill()


def test_the_machine_answers_the_driver_byte_for_byte():
    bench = Bench(temperature=lambda t: 25.0)
    with bench.filter() as device:
        assert bench.line.since() == joined(_OPENING)
        device.set_wavelength(633e-9)
        assert bench.line.since() == joined(_TO_633)


def test_it_is_a_spectral_filter_that_tunes_the_light():
    tuned = []
    bench = Bench(on_tuned=tuned.append)
    with bench.filter(bandwidth_nm=7.0, settling_ms=150.0) as device:
        checked: SpectralFilter = device
        before = bench.clock.now()
        setting = checked.set_wavelength(532.004e-9)
        assert (setting.request, setting.actual) == (532.004e-9, 532e-9)
        assert tuned[-1] == checked.wavelength == 532e-9
        assert before + 0.15 < setting.ready_at <= bench.clock.now() + 0.15
        assert checked.bandwidth == pytest.approx(7e-9)
        assert not checked.identity.simulated
        assert checked.settling == pytest.approx(0.15)
        with pytest.raises(DeviceError, match=r"out of range, 400\.00 to 720\.00 nm"):
            checked.set_wavelength(399.99e-9)
        assert tuned[-1] == 532e-9
    assert tuned[-1] == 400e-9


def test_what_is_out_of_range_is_not_even_sent():
    bench = Bench()
    with bench.filter() as device:
        bench.line.since()
        with pytest.raises(DeviceError):
            device.set_wavelength(900e-9)
        assert bench.line.since() == (b"", b"")


@pytest.mark.parametrize(("celsius", "slower"), [(20, 1), (35, 1), (10, 1.6535), (5, 2.155)])
def test_settling_takes_longer_in_the_cold(celsius, slower):
    # By hand: exp(ln 2 (1/T - 1/293.15) / (1/293.15 - 1/308.15)).
    assert settling_factor(celsius) == pytest.approx(slower, abs=0.001)
    bench = Bench(temperature=lambda t: celsius)
    with bench.filter() as device:
        assert device.settling == pytest.approx(0.05 * slower, rel=0.01)


def test_opening_initialises_with_progress_where_it_must():
    bench = Bench(initialises=False)
    told = []
    device = bench.filter(exercise=True)
    device.progress = lambda what, share: told.append((what, share))
    with device:
        assert 30 < bench.clock.now() < 33
        assert [share for _, share in told] == sorted(share for _, share in told)
        assert told[0] == ("initialising", 0.0)
        assert told[-1] == ("initialising", 1.0)
        assert device.alive_at > 0
        assert "initialised 0.0 h ago" in device.health()["initialised"]


def test_opening_waits_for_a_power_up_and_does_not_abort_it():
    bench = Bench(powered_at=-10.0)
    with bench.filter():
        assert 20 < bench.clock.now() < 23


def test_opening_may_always_initialise_or_only_correct():
    bench = Bench()
    with bench.filter(recalibrate="always"):
        assert 30 < bench.clock.now() < 33
    with bench.filter(recalibrate="correct") as device:
        assert bench.clock.now() < 35
        assert "corrected" in device.health()["initialised"]


def test_it_advises_to_initialise_after_eight_hours_or_three_degrees():
    heat = [22.0]
    bench = Bench(temperature=lambda t: heat[0])
    with bench.filter() as device:
        assert device.health()["advice"] == "none"
        heat[0] = 25.5
        assert "initialise it: refresh()" in device.health()["advice"]
        device.set_wavelength(500e-9)
        device.refresh()
        assert device.wavelength == 500e-9
        assert device.health()["advice"] == "none"
        bench.later(8.1 * 3600)
        assert "initialise" in device.health()["advice"]
        device.refresh(completely=False)
        assert device.health()["advice"] == "none"


def test_a_palette_is_used_where_it_was_defined():
    bench = Bench(electronics="rs232")
    with bench.filter(palette_nm=(450.0, 550.0, 650.0)) as device:
        assert device.palette == (450e-9, 550e-9, 650e-9)
        bench.line.since()
        began = bench.clock.now()
        assert device.set_wavelength(650e-9).actual == 650e-9
        assert bench.clock.now() - began < 0.1
        assert bench.line.since()[0] == b"P 2\rR ?\rW ?\r"
        assert device.set_wavelength(600e-9).actual == 600e-9
        assert bench.clock.now() - began > 0.3
        assert device.choose(0).actual == 450e-9
        with pytest.raises(DeviceError, match="no such element of the palette"):
            device.choose(3)
        device.clear_palette()
        assert device.palette == ()
        device.set_wavelength(650e-9)
        assert b"W 650.00" in bench.line.since()[0]


def test_a_full_palette_is_defined_and_read():
    bench = Bench()
    with bench.filter() as device:
        wanted = [(400 + n) * 1e-9 for n in range(128)]
        assert device.define_palette(wanted) == pytest.approx(wanted)
        with pytest.raises(DeviceError, match="no such element of the palette"):
            device.define_palette([*wanted, 600e-9])
        device.set_wavelength(600e-9)


def test_it_sleeps_and_is_awakened():
    bench = Bench()
    with bench.filter() as device:
        device.sleep()
        assert bench.machine.state.asleep
        device.awaken()
        assert device.wavelength == 550e-9
        device.sleep()
        assert device.set_wavelength(500e-9).actual == 500e-9
        device.sleep()
    bench.machine.state.asleep = True
    with pytest.raises(DeviceError, match="serial number"):
        bench.filter().__enter__()
    with bench.filter(serial="50527") as device:
        assert not bench.machine.state.asleep


def test_the_temperature_is_read_again_after_ten_minutes():
    heat = [20.0]
    bench = Bench(temperature=lambda t: heat[0])
    with bench.filter() as device:
        heat[0] = 10.0
        device.set_wavelength(500e-9)
        assert device.settling == pytest.approx(0.05)
        bench.later(601.0)
        setting = device.set_wavelength(510e-9)
        assert setting.ready_at - bench.clock.now() == pytest.approx(0.0827, abs=1e-4)


def test_infrared_models_are_advised_to_settle_longer():
    bench = Bench(range_nm=(650.0, 1100.0))
    with bench.filter() as device:
        assert "150 ms" in device.health()["advice"]
    with bench.filter(settling_ms=150.0) as device:
        assert device.health()["advice"] == "none"


def test_a_closed_filter_is_not_opened_by_a_command():
    bench = Bench()
    with bench.filter() as device:
        pass
    with pytest.raises(DeviceError, match="it is not open"):
        device.set_wavelength(500e-9)


def test_another_filter_is_refused():
    bench = Bench()
    with pytest.raises(DeviceError, match="it is number 50527, not 12345"):
        bench.filter(serial="12345").__enter__()
    with bench.filter() as device:
        bench.machine.serial = 50528
        bench.line.inject(WireFault("disconnect", bench.clock.now(), 1.0))
        with pytest.raises(DeviceError, match="Plug"):
            device.set_wavelength(500e-9)
        bench.later(2.0)
        with pytest.raises(DeviceError, match="another filter answers"):
            device.set_wavelength(500e-9)


def lose_power(bench, device):
    bench.line.inject(WireFault("disconnect", bench.clock.now(), 1.0))
    with pytest.raises(DeviceError):
        device.set_wavelength(500e-9)
    bench.later(1.0)
    bench.machine.power_up(bench.clock.now())
    with pytest.raises(DeviceError, match="busy, initialising itself"):
        device.set_wavelength(500e-9)


def test_a_filter_that_lost_its_power_initialises_itself_undisturbed_and_works_again():
    bench = Bench()
    with bench.filter(palette_nm=(500.0,)) as device:
        lose_power(bench, device)
        bench.later(30.0)
        assert device.set_wavelength(500e-9).actual == 500e-9
        assert (bench.machine.state.wavelength, bench.machine.state.sync) == (500, 0)


def test_a_plug_that_was_out_while_it_calculated_costs_one_command_only():
    bench = Bench(electronics="rs232")
    with bench.filter() as device:
        bench.line.inject(WireFault("disconnect", bench.clock.now() + 0.03, 1.0))
        with pytest.raises(DeviceError, match="Plug"):
            device.set_wavelength(500e-9)
        bench.line.clear_faults()
        assert device.set_wavelength(510e-9).actual == 510e-9


def test_refreshing_waits_for_a_power_up():
    bench = Bench()
    with bench.filter() as device:
        lose_power(bench, device)
        began = bench.clock.now()
        device.refresh()
        assert 59 < bench.clock.now() - began < 63


@pytest.mark.parametrize("completely", [True, False])
def test_refreshing_leaves_the_filter_at_its_wavelength(completely):
    """Who goes on measuring sees the light that was set, and waits as the cold asks for now."""
    tuned, heat = [], [25.0]
    bench = Bench(on_tuned=tuned.append, temperature=lambda t: heat[0])
    with bench.filter(settling_ms=100.0) as device:
        device.set_wavelength(633e-9)
        tuned.clear()
        heat[0] = 5.0
        device.refresh(completely=completely)
        assert set(tuned) == {633e-9}
        assert device.wavelength == 633e-9
        assert device.settling == pytest.approx(0.1 * settling_factor(5.0))
    assert settling_factor(5.0) > 1.2


def test_a_filter_that_lost_its_power_is_ready_once_opened_again():
    bench = Bench()
    supervised = SupervisedDevice("filter", bench.filter)
    with supervised:
        lose_power(bench, supervised)
        supervised.revive()
        assert supervised.set_wavelength(500e-9).actual == 500e-9
        assert bench.machine.state.sync == 0


def test_every_error_code_is_told_in_words():
    bench = Bench()
    with bench.filter() as device:
        bench.line.inject(WireFault("error code"))
        with pytest.raises(DeviceError, match="error 8: it could not calculate its drive levels"):
            device.set_wavelength(500e-9)
        bench.line.clear_faults()
        assert device.set_wavelength(500e-9).actual == 500e-9
        bench.line.inject(WireFault("uninitialised"))
        with pytest.raises(DeviceError, match=r"error 4: it is not initialised. Initialise it"):
            device.set_wavelength(510e-9)
        with pytest.raises(DeviceError, match="it is not tuned"):
            _ = device.wavelength
        bench.line.clear_faults()


def test_a_late_answer_is_never_taken_for_another_ones():
    bench = Bench()
    with bench.filter() as device:
        for late in (0.3, 0.9, 1.5, 2.0, 3.0):
            bench.line.inject(WireFault("delayed", bench.clock.now(), 0.05, delay=late))
            for nm in range(500, 560, 10):
                try:
                    assert device.set_wavelength(nm / 1e9).actual == nm / 1e9
                except DeviceError:
                    continue
                assert bench.machine.state.wavelength == nm
            bench.line.clear_faults()


def test_a_wrong_echo_is_an_error_that_shows_both():
    bench = Bench()
    with bench.filter() as device:
        bench.line.inject(WireFault("wrong echo"))
        with pytest.raises(DeviceError, match="is echoed as") as e:
            device.set_wavelength(500e-9)
        assert "cable" in e.value.remedy
        bench.line.clear_faults()


def test_a_temperature_is_believed_once_three_answers_agree():
    told = iter([20.0, 28.0, 20.0, 28.0, 28.1, 28.0])
    bench = Bench(temperature=lambda t: 25.0)
    with bench.filter() as device:
        bench.machine._heat = lambda t: next(told)
        assert device.temperature == 28.0
        told = iter([20.0, 28.0] * 50)
        with pytest.raises(DeviceError, match="its answers differ"):
            _ = device.temperature
        bench.machine._heat = lambda t: 25.0


def test_a_call_that_goes_on_is_ended_by_kill():
    clock = RealClock()
    line = SimulatedLine(VariSpecMachine(), baudrate=115200)
    device = VariSpec(Surroundings(clock), port=plug_in("varispec", line, clock), baudrate=115200)
    device.__enter__()
    line.inject(WireFault("busy forever"))
    threading.Timer(0.1, device.kill).start()
    with pytest.raises(DeviceError, match="given up"):
        device.refresh()
    device.__exit__(None, None, None)


def test_over_a_pseudo_terminal_it_is_the_same(tmp_path):
    clock, path = RealClock(), tmp_path / "varispec"
    machine = VariSpecMachine()
    line = SimulatedLine(machine, baudrate=115200)
    with (
        PtyLine(line, path, clock),
        VariSpec(Surroundings(clock), port=str(path), baudrate=115200) as device,
    ):
        assert device.set_wavelength(500e-9).actual == 500e-9
        line.inject(WireFault("bit flips", clock.now(), 0.2))
        for nm in (510, 520, 530):
            try:
                device.set_wavelength(nm * 1e-9)
            except DeviceError:
                continue
            assert machine.state.wavelength == nm
        line.clear_faults()
        line.inject(WireFault("disconnect"))
        while path.exists():
            clock.wait_until(clock.now() + 0.02, lambda: False)
        with pytest.raises(DeviceError, match="port"):
            device.set_wavelength(540e-9)
        line.clear_faults()
        while not path.exists():
            clock.wait_until(clock.now() + 0.05, lambda: False)
        assert device.set_wavelength(550e-9).actual == 550e-9
        assert machine.state.wavelength == 550


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("port", ""),
        ("baudrate", 4800),
        ("settling_ms", -1),
        ("settling_ms", math.nan),
        ("bandwidth_nm", "10"),
        ("recalibrate", "often"),
        ("exercise", "yes"),
        ("palette_nm", (1.0,)),
        ("palette_nm", range(400, 600)),
        ("palette_nm", 500.0),
        ("palette_nm", ("500",)),
        ("serial", "x"),
        ("serial", 50527),
        ("baudrate", [9600]),
        ("terminator", "\n\r"),
    ],
)
def test_bad_options_are_named(option, value):
    with pytest.raises(ValueError, match=option):
        VariSpec(Surroundings(VirtualClock()), **{option: value})


def test_nothing_can_be_asked_before_it_is_open():
    device = VariSpec(Surroundings(VirtualClock()))
    for ask in (lambda: device.identity, lambda: device.wavelength, device.make_safe):
        with pytest.raises(DeviceError, match="it is not open"):
            ask()


class Babbling:
    """Says whatever it is given instead of answers, after echoing or not."""

    own_faults = ()

    def __init__(self, said, echoes) -> None:
        self.said, self.echoes = list(said), echoes

    def feed(self, data, t):
        if not data:
            return []
        echo = [Reply(t, data)] if self.echoes else []
        due = self.said and data in b"!@\r"
        return [*echo, Reply(t, self.said.pop(0) or b"?")] if due else echo

    def set_fault(self, kind):
        pass


_PIECES = st.one_of(
    st.binary(min_size=1, max_size=40),
    st.sampled_from([b">", b"<", b"@", b"C", b"R     0\r", b"W 550.00\r", b"W*\r", b"Y  25.0\r"]),
    st.sampled_from(
        [b"v   141  400.00  720.00 50527\r", b"D     3\r", b"D 450.00\r", b"R    12\r"]
    ),
)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(said=st.lists(_PIECES, max_size=60), echoes=st.booleans())
def test_nonsense_only_ever_makes_device_errors(said, echoes):
    bench = Bench(VariSpecMachine())
    device = bench.filter().__enter__()
    bench.line.machine = Babbling(said, echoes)
    for nm in (500, 510):
        began = bench.clock.now()
        with contextlib.suppress(DeviceError):
            assert device.set_wavelength(nm / 1e9).actual == nm / 1e9
        assert bench.clock.now() - began < device.reply_time + 1
    other = Bench(Babbling(said, echoes))
    with contextlib.suppress(DeviceError):
        other.filter().__enter__()
    assert other.clock.now() < 60


def test_importing_it_loads_no_vendor_package():
    code = (
        "import sys, drivers.varispec, drivers.serial_line; "
        "print({'serial', 'usb', 'torch', 'PySide6', 'simulator'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
