"""A serial port by the bench's clock, in the process and over a pseudo-terminal."""

from __future__ import annotations

import os
import sys
import threading
import time

import forked
import pytest

from drivers import serial_line
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.serial_line import SerialLine
from simulator.clock import VirtualClock
from simulator.machines.machine import Reply
from simulator.wire import SimulatedLine, WireFault, plug_in, unplug
from simulator.wire.pty import PtyLine


class Echo:
    own_faults = ()

    def feed(self, data, t):
        return [Reply(t, data)] if data else []

    def set_fault(self, kind):
        pass


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture
def wire(clock):
    line = SimulatedLine(Echo(), baudrate=9600)
    plug_in("echo", line, clock)
    yield line
    unplug("echo")


@pytest.fixture
def port(wire, clock):
    port = SerialLine("echo", "sim://echo", clock, baudrate=9600)
    port.open()
    yield port
    port.close()


def test_what_is_written_comes_back_after_its_time(port, clock):
    port.write(b"abc\rd", "say abc")
    assert port.read_until(b"\r", "say abc", 1.0) == b"abc\r"
    assert clock.now() == pytest.approx(5 * 10 / 9600)
    assert port.read(1, "say abc", 1.0) == b"d"
    assert clock.now() == pytest.approx(6 * 10 / 9600)


def test_a_timeout_costs_virtual_time_only_and_tells_what_came(port, clock):
    port.in_sync = True
    port.write(b"abc", "say abc")
    with pytest.raises(
        DeviceError, match=r"say abc: it broke off after b'abc': no more within 500 s"
    ) as e:
        port.read_until(b"\r", "say abc", 500.0)
    assert clock.now() == pytest.approx(500.0)
    assert "cable" in e.value.remedy
    assert not port.in_sync
    assert port.drain(0.1, 1.0) == b"abc"
    with pytest.raises(DeviceError, match="no reply within 2 s"):
        port.read(1, "read", 2.0)


def test_all_reads_end_within_what_is_granted_to_them_together(port, clock):
    with port.within(1.0):
        for _ in range(3):
            with pytest.raises(DeviceError):
                port.read(1, "read", 0.6)
    assert clock.now() == pytest.approx(1.0)


def test_settling_discards_until_it_is_quiet(port, clock):
    port.write(b"x" * 96, "babble")
    assert port.drain(0.05, 1.0) == b"x" * 96
    assert clock.now() == pytest.approx(97 * 10 / 9600 + 0.05)
    port.write(b"x" * 960, "babble")
    with pytest.raises(DeviceError, match="doesn't stop talking"):
        port.drain(0.05, 0.5)


def test_a_port_that_was_pulled_is_opened_again_by_the_next_command(port, wire, clock):
    wire.inject(WireFault("disconnect", at=1.0, seconds=2.0))
    with pytest.raises(DeviceError, match="disconnected") as e:
        port.read(1, "wait", 10.0)
    assert clock.now() == pytest.approx(1.0)
    assert "Plug" in e.value.remedy
    assert not port.is_open
    with pytest.raises(DeviceError, match=r"there is no such port\. Plug the device in"):
        port.write(b"a", "say a")
    with pytest.raises(DeviceError, match="port is closed"):
        port.read(1, "read", 1.0)
    clock.wait_until(3.0, lambda: False)
    port.write(b"a", "say a")
    assert port.read(1, "say a", 1.0) == b"a"


def test_a_port_pulled_and_mended_unseen_is_dead_all_the_same(port, wire, clock):
    clock.wait_until(1.0, lambda: False)
    wire.receive(1.0)
    wire.inject(WireFault("disconnect"))
    wire.clear_faults()
    with pytest.raises(DeviceError, match="disconnected"):
        port.write(b"a", "say a")
    port.write(b"a", "say a")


def test_a_port_belongs_to_one(port, clock):
    other = SerialLine("other", "sim://echo", clock, baudrate=9600)
    with pytest.raises(DeviceError, match="another program uses it") as e:
        other.open()
    assert "other program" in e.value.remedy
    port.close()
    other.open()
    other.close()


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("sim://nobody", "there is no such port. Plug the device in"),
        ("/nowhere/tty", "there is no such port. Plug the device in"),
        ("socket://127.0.0.1:1", "nobody serves it there. Start the program"),
        ("rfc2217://127.0.0.1:1", ""),
        ("/dev/null", "it is no serial port. Look up the device's port"),
        ("/dev", "it is no serial port. Look up the device's port"),
    ],
)
def test_a_port_that_cannot_be_opened_is_a_device_error(url, said, wire, clock):
    with pytest.raises(DeviceError, match=f"thing: open: port {url}: {said}"):
        SerialLine("thing", url, clock, baudrate=9600).open()


def test_a_read_is_ended_from_outside(tmp_path):
    clock = RealClock()
    with PtyLine(SimulatedLine(Echo(), baudrate=9600), tmp_path / "tty", clock):
        port = SerialLine("echo", str(tmp_path / "tty"), clock, baudrate=9600)
        port.open()
        port.write(b"ab", "wait")
        threading.Timer(0.1, port.cancel).start()
        # Not the device's silence: nobody shall look for a bad cable.
        with pytest.raises(DeviceError, match="wait: the device was given up"):
            port.read(3, "wait", 1000.0)
        port.close()


def test_over_a_pseudo_terminal_it_is_the_same(tmp_path):
    clock, path = RealClock(), tmp_path / "tty"
    wire = SimulatedLine(Echo(), baudrate=9600)
    with PtyLine(wire, path, clock):
        port = SerialLine("echo", str(path), clock, baudrate=9600)
        port.open()
        with pytest.raises(DeviceError, match="other program"):
            SerialLine("other", str(path), clock, baudrate=9600).open()
        port.write(b"abc\r", "say abc")
        assert port.read_until(b"\r", "say abc", 5.0) == b"abc\r"
        assert clock.now() >= 5 * 10 / 9600
        with pytest.raises(DeviceError, match="no reply within"):
            port.read(1, "read", 0.05)
        wire.inject(WireFault("disconnect"))
        with pytest.raises(DeviceError, match=r"port .*tty"):
            port.read(1, "read", 5.0)
        with pytest.raises(DeviceError, match="there is no such port"):
            port.write(b"x", "say x")
        wire.clear_faults()
        while not path.exists():
            time.sleep(0.01)
        port.write(b"x", "say x")
        assert port.read(1, "say x", 5.0) == b"x"
        port.close()
    assert not path.exists()


@pytest.mark.parametrize(
    "url",
    [
        "spy://loop://?file={}", "spy:///dev/ttyUSB0?file={}", "alt://{}?class=Serial", "loop://",
        "hwgrep://.*", "gopher://x", "socket://x", "socket://x:1?logging=debug", "ttyUSB0", "", 5,
        "socket://x:1/../{}", "COM3; rm {}",
    ],
)  # fmt: skip
def test_a_port_that_does_more_than_a_port_is_refused_and_no_file_changes(tmp_path, clock, url):
    kept = tmp_path / "kept"
    kept.write_text("kept")
    with pytest.raises(ValueError, match="port is"):
        SerialLine("echo", url.format(kept) if isinstance(url, str) else url, clock, baudrate=9600)
    assert kept.read_text() == "kept"


def test_a_port_that_is_no_file_any_more_is_gone(tmp_path, port, clock):
    assert port.unplugged_reason() is None
    path = tmp_path / "ttyUSB0"
    line = SerialLine("echo", str(path), clock, baudrate=9600)
    assert line.unplugged_reason() == f"port {path} isn't there any more"
    path.touch()
    assert line.unplugged_reason() == ""
    path.rename(tmp_path / "pts")
    path.symlink_to(tmp_path / "pts")
    assert line.unplugged_reason() == ""
    (tmp_path / "pts").unlink()
    assert "isn't there" in line.unplugged_reason()


RIVAL = """
import fcntl, os, sys
if {user}:
    os.setgroups([]); os.setgid({user}); os.setuid({user})
port = os.open({port!r}, os.O_RDWR | os.O_NOCTTY)
if {locked}:
    fcntl.flock(port, fcntl.LOCK_EX)
print("open", flush=True)
sys.stdin.readline()
"""

NOBODY = 65534 if os.geteuid() == 0 else 0


@pytest.mark.parametrize("locked", [True, False])
def test_who_has_a_port_open_is_named_and_its_far_end_is_not_meant(locked, tmp_path):
    """Another user, where the tests are root's: who has no lock is seen only by root, and its own.

    The far end of the pseudo-terminal, which this process has open, is the device itself.
    """
    with PtyLine(SimulatedLine(Echo(), baudrate=9600), tmp_path / "port"):
        name = os.path.realpath(tmp_path / "port")
        os.chmod(name, 0o666)
        port = SerialLine("echo", str(tmp_path / "port"), RealClock(), baudrate=9600)
        code = RIVAL.format(user=NOBODY, port=name, locked=locked)
        with forked.Popen(
            [sys.executable, "-c", code], stdin=forked.PIPE, stdout=forked.PIPE, text=True
        ) as rival:
            assert rival.stdout.readline() == "open\n"
            of_user = " of nobody" if NOBODY else ""
            words = rf"is in use by .* \(process {rival.pid}{of_user}\)\. Close that first"
            with pytest.raises(DeviceError, match=words):
                port.open()
            assert not port.is_open
            rival.kill()
            rival.wait(10)
        port.open()
        port.close()


@pytest.mark.skipif(not NOBODY, reason="only root may become another user")
def test_a_port_of_a_device_is_closed_to_other_users_while_it_is_open(tmp_path):
    """By TIOCEXCL, which pseudo-terminals aren't given: it would outlive a killed process."""
    near, far = os.openpty()
    name = os.ttyname(far)
    os.chmod(name, 0o666)
    port = SerialLine("echo", name, RealClock(), baudrate=9600)
    port.open()
    assert tries_to_open(name) == "opened\n"
    serial_line._forbid_others(port._port.fileno())
    assert tries_to_open(name) == "EBUSY\n"
    port.close()
    for end in (near, far):
        os.close(end)


def tries_to_open(name):
    code = (
        "import errno, os; os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
        f"try:\n    os.open({name!r}, os.O_RDWR | os.O_NOCTTY); print('opened')\n"
        "except OSError as error: print(errno.errorcode[error.errno])\n"
    )
    done = forked.run([sys.executable, "-c", code], stdout=forked.PIPE, text=True)
    return done.stdout
