"""A device whose user is killed with SIGKILL is made safe by its guard, seen at the wire."""

from __future__ import annotations

import os
import signal
import sys
import time

import forked
import pytest

from drivers.clock import RealClock
from drivers.hosted import HostedDevice
from drivers.interfaces import Surroundings
from drivers.supervised import SupervisedDevice
from simulator.machines.thorlabs_wheel import ThorlabsWheelMachine
from simulator.wire import SimulatedLine
from simulator.wire.pty import PtyLine

SLOTS = [[400 + 10 * number, 5] for number in range(6)]

PATIENCE = 30.0
"""Seconds after which a guard that hasn't done its work won't."""

USER = """
import os, sys, time
from drivers.clock import RealClock
from drivers.hosted.guard import GuardedDevice, guard_devices
from drivers.interfaces import Surroundings
from drivers.thorlabs_wheel import ThorlabsWheel
options = {{"port": {port!r}, "slots_nm": {slots!r}}}
os.setpgid(0, 0)
with guard_devices([GuardedDevice("wheel", "drivers.thorlabs_wheel:ThorlabsWheel", options)]):
    wheel = ThorlabsWheel(Surroundings(RealClock()), **options).__enter__()
    wheel.set_slot(2)
    print("turned", flush=True)
    sys.stdin.readline()
print("released", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def wheel(tmp_path):
    """A wheel behind a pseudo-terminal, which outlives who uses it; it's asked at its machine."""
    slots = []
    machine = ThorlabsWheelMachine(6, on_slot=slots.append)
    with PtyLine(SimulatedLine(machine, baudrate=115200), tmp_path / "wheel") as line:
        yield str(line.path), slots


def user_of(port):
    code = USER.format(port=port, slots=SLOTS)
    return forked.Popen(
        [sys.executable, "-c", code],
        stdin=forked.PIPE,
        stdout=forked.PIPE,
        stderr=forked.PIPE,
        text=True,
    )


def test_a_device_is_made_safe_when_the_whole_group_of_its_user_is_killed(wheel):
    port, slots = wheel
    with user_of(port) as user:
        assert user.stdout.readline() == "turned\n"
        assert slots[-1] == 2
        os.killpg(user.pid, signal.SIGKILL)
        assert user.wait(PATIENCE) == -signal.SIGKILL
        # Its output ends when the guard has ended, too.
        assert user.stderr.read() == "the program was killed; the wheel was made safe\n"
    assert slots[-1] == 1


def test_a_guard_that_was_released_ends_and_does_nothing(wheel):
    port, slots = wheel
    with user_of(port) as user:
        assert user.stdout.readline() == "turned\n"
        user.stdin.write("\n")
        user.stdin.flush()
        assert user.stdout.readline() == "released\n"
        user.kill()
        assert user.stderr.read() == ""
    assert slots[-1] == 2


def test_a_guard_that_cannot_open_the_device_says_so(tmp_path):
    with user_of(str(tmp_path / "nowhere")) as user:
        assert "there is no such port" in user.stderr.read()


def test_a_device_whose_process_was_killed_is_opened_again_to_make_it_safe(tmp_path):
    notes = tmp_path / "notes"
    options = {"notes": str(notes)}

    def make():
        place = Surroundings(RealClock())
        return HostedDevice(place, "modest", "hosted_devices:Modest", options)

    with SupervisedDevice("camera", make) as device:
        os.kill(device.process, signal.SIGKILL)
        while not device._device.is_dead:
            time.sleep(0.01)
        device.make_safe()
        assert notes.read_text().split() == ["entered", "entered", "safe"]
