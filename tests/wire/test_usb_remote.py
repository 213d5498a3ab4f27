import contextlib
import subprocess
import sys
from multiprocessing.connection import Client

import pytest

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.hosted.calls import CallRequest
from drivers.interfaces import Surroundings
from drivers.starlight_wheel import StarlightWheel
from drivers.zwo_wheel import ZwoWheel
from simulator.machines.usb_wheels import StarlightWheelMachine, ZwoWheelMachine
from simulator.wire.faults import WireFault
from simulator.wire.usb_backend import UsbBus
from simulator.wire.usb_remote import RemoteBackend, UsbServer, backend_option

SEVEN = [[400 + 10 * i, 5] for i in range(7)]

SERVING = """
import sys
from drivers.clock import RealClock
from simulator.machines.usb_wheels import StarlightWheelMachine
from simulator.wire.usb_backend import UsbBus
from simulator.wire.usb_remote import UsbServer

bus = UsbBus(RealClock())
bus.plug_in(StarlightWheelMachine(step=0.01))
with UsbServer(bus, sys.argv[1]):
    print("ready", flush=True)
    sys.stdin.read()
"""


@contextlib.contextmanager
def another_process(path):
    command = [sys.executable, "-c", SERVING, str(path)]
    with subprocess.Popen(command, stdin=-1, stdout=-1, text=True) as process:
        try:
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


def wheel_at(path):
    return StarlightWheel(Surroundings(RealClock()), SEVEN, backend=backend_option(path))


def test_a_driver_turns_a_wheel_of_another_process_and_finds_it_again(tmp_path):
    path = tmp_path / "usb"
    with another_process(path):
        wheel = wheel_at(path)
        wheel.__enter__()
        assert wheel.set_slot(4).actual == 4
    with pytest.raises(DeviceError, match="unplugged"):
        _ = wheel.slot
    with pytest.raises(DeviceError, match="no USB device 1278:0920 is there"):
        _ = wheel.slot
    with another_process(path):
        assert wheel.slot == 1
        wheel.__exit__(None, None, None)


def test_two_drivers_and_faults_at_one_bus(tmp_path):
    path = tmp_path / "usb"
    bus = UsbBus(RealClock())
    starlight = bus.plug_in(StarlightWheelMachine(step=0.01))
    bus.plug_in(ZwoWheelMachine(step=0.01))
    zwo = ZwoWheel(Surroundings(RealClock()), SEVEN, backend=backend_option(path), step_ms=500)
    with UsbServer(bus, path), wheel_at(path) as wheel, zwo:
        assert (wheel.set_slot(2).actual, zwo.set_slot(2).actual) == (2, 2)
        starlight.inject(WireFault("stall"))
        with pytest.raises(DeviceError, match="refuses the command"):
            wheel.set_slot(3)
        starlight.clear_faults()
        starlight.denied = True
        starlight.inject(WireFault("disconnect", at=0, seconds=0))
        with pytest.raises(DeviceError, match="unplugged"):
            wheel.set_slot(3)
        with pytest.raises(DeviceError, match="denies access"):
            wheel.set_slot(3)
        starlight.denied = False
        assert wheel.set_slot(3).actual == 3
        starlight.inject(WireFault("silence"))
        with pytest.raises(DeviceError, match="no answer within 1 s"):
            wheel.set_slot(4)
        starlight.clear_faults()
    assert not path.exists()
    assert not (tmp_path / "usb.key").exists()


def test_strangers_are_not_served(tmp_path):
    path = tmp_path / "usb"
    bus = UsbBus(RealClock())
    bus.plug_in(StarlightWheelMachine())
    with UsbServer(bus, path):
        assert (tmp_path / "usb.key").stat().st_mode & 0o077 == 0
        with pytest.raises(Exception, match=r"digest|authentication|key") as refused:
            Client(str(path), "AF_UNIX", authkey=b"wrong")
        assert refused.type.__name__ == "AuthenticationError"
        backend = RemoteBackend(str(path))
        assert backend.enumerate_devices() == [1]
        with pytest.raises(AttributeError):
            _ = backend.plug_in
        with pytest.raises(AttributeError, match="plug_in"):
            backend._exchange(CallRequest("plug_in", (1,)), 1.0).result()


def test_where_nobody_serves_there_are_no_devices(tmp_path):
    assert RemoteBackend(str(tmp_path / "usb")).enumerate_devices() == []
