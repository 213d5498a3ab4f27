import pytest
import usb.core
import usb.util

from simulator.clock import VirtualClock
from simulator.machines.usb_wheels import StarlightWheelMachine, TurningWheel, ZwoWheelMachine
from simulator.wire.faults import WIRE_FAULT_KINDS, WireFault
from simulator.wire.usb_backend import UsbBus, bus, register_bus, unregister_bus

WHERE = bytes.fromhex("03 7e 5a 02 01").ljust(16, b"\0")


@pytest.fixture
def clock():
    return VirtualClock()


def found(backend, vendor=0x1278):
    return usb.core.find(backend=backend, idVendor=vendor)


def test_pyusb_finds_what_is_plugged_in(clock):
    backend = UsbBus(clock)
    assert found(backend) is None
    backend.plug_in(StarlightWheelMachine(serial="5"))
    backend.plug_in(ZwoWheelMachine())
    device = found(backend)
    assert (device.manufacturer, device.product) == ("Starlight Xpress", "SX Filter Wheel")
    assert device.serial_number == "5"
    interface = device.get_active_configuration()[(0, 0)]
    assert interface.bInterfaceClass == 3
    assert [e.bEndpointAddress for e in interface] == [0x81, 0x01]
    assert found(backend, 0x03C3).product == "EFW"
    assert "1278:0920" in str(device)


def test_a_plain_script_drives_it(clock):
    """As a script for the real wheel would, with pyusb alone."""
    backend = UsbBus(clock)
    seen = []
    backend.plug_in(StarlightWheelMachine(step=0.5, on_slot=seen.append))
    device = found(backend)
    if device.is_kernel_driver_active(0):
        device.detach_kernel_driver(0)
    device.ctrl_transfer(0x21, 9, 0x0200, 0, b"\x03\x00")
    assert device.read(0x81, 2).tobytes() == b"\x00\x07"
    clock.wait_until(1.2, lambda: False)
    device.write(0x01, b"\x00\x00")
    assert device.read(0x81, 2).tobytes() == b"\x03\x07"
    assert seen == [2, 3]
    with pytest.raises(usb.core.USBTimeoutError):
        device.read(0x81, 2, 250)
    # 1 ms for each of two answers.
    assert clock.now() == pytest.approx(1.2 + 0.001 + 0.25)
    with pytest.raises(usb.core.USBError) as stall:
        device.ctrl_transfer(0xC0, 1, 0, 0, 4)
    assert stall.value.errno == 32


def test_a_device_that_the_system_holds_is_busy(clock):
    backend = UsbBus(clock)
    backend.plug_in(StarlightWheelMachine())
    with pytest.raises(usb.core.USBError) as busy:
        found(backend).read(0x81, 2)
    assert busy.value.errno == 16


def test_unplugged_is_gone_and_comes_back_elsewhere(clock):
    backend = UsbBus(clock)
    plug = backend.plug_in(ZwoWheelMachine())
    device = found(backend, 0x03C3)
    device.detach_kernel_driver(0)
    device.ctrl_transfer(0x21, 9, 0x0303, 0, WHERE)
    plug.inject(WireFault("disconnect", at=1.0, seconds=1.0))
    clock.wait_until(1.5, lambda: False)
    assert found(backend, 0x03C3) is None
    clock.wait_until(2.0, lambda: False)
    with pytest.raises(usb.core.USBError) as gone:
        device.ctrl_transfer(0xA1, 1, 0x0301, 0, 17)
    assert gone.value.errno == 19
    again = found(backend, 0x03C3)
    assert again.address != device.address
    assert again.is_kernel_driver_active(0)
    again.reset()


def test_a_pulled_plug_ends_a_transfer_that_waits(clock):
    backend = UsbBus(clock)
    plug = backend.plug_in(StarlightWheelMachine())
    device = found(backend)
    device.detach_kernel_driver(0)
    plug.inject(WireFault("disconnect", at=0.4, seconds=9))
    with pytest.raises(usb.core.USBError) as gone:
        device.read(0x81, 2, 1000)
    assert gone.value.errno == 19
    assert clock.now() == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("kind", "comes"),
    [("silence", None), ("mute", None), ("duplicated", [b"\x01\x07", b"\x01\x07"]),
     ("byte by byte", [b"\x01", b"\x07"]), ("delayed", None)],
)  # fmt: skip
def test_faults_do_to_reports_what_they_say(clock, kind, comes):
    backend = UsbBus(clock)
    plug = backend.plug_in(StarlightWheelMachine())
    device = found(backend)
    device.detach_kernel_driver(0)
    plug.inject(WireFault(kind))
    if kind == "silence":
        with pytest.raises(usb.core.USBTimeoutError):
            device.ctrl_transfer(0x21, 9, 0x0200, 0, b"\0\0")
    else:
        device.ctrl_transfer(0x21, 9, 0x0200, 0, b"\0\0")
    if comes is None:
        with pytest.raises(usb.core.USBTimeoutError):
            device.read(0x81, 2, 1000)
    for data in comes or []:
        assert device.read(0x81, 2).tobytes() == data
    if kind == "delayed":
        clock.wait_until(4.0, lambda: False)
        assert device.read(0x81, 2).tobytes() == b"\x01\x07"


@pytest.mark.parametrize("kind", ["garbage", "truncated", "wrong echo", "bit flips"])
def test_other_faults_change_what_comes(clock, kind):
    backend = UsbBus(clock)
    plug = backend.plug_in(ZwoWheelMachine())
    device = found(backend, 0x03C3)
    device.detach_kernel_driver(0)
    device.ctrl_transfer(0x21, 9, 0x0303, 0, WHERE)
    right = device.ctrl_transfer(0xA1, 1, 0x0301, 0, 17).tobytes()
    device.ctrl_transfer(0x21, 9, 0x0303, 0, bytes.fromhex("03 7e 5a 02 04").ljust(16, b"\0"))
    plug.inject(WireFault(kind, share=1.0))
    struck = device.ctrl_transfer(0xA1, 1, 0x0301, 0, 17).tobytes()
    plug.clear_faults()
    after = device.ctrl_transfer(0xA1, 1, 0x0301, 0, 17).tobytes()
    assert struck != after
    assert (struck == right) == (kind == "wrong echo")


def test_a_fault_that_a_machine_cannot_have_is_refused(clock):
    plug = UsbBus(clock).plug_in(StarlightWheelMachine())
    with pytest.raises(ValueError, match="kind is 'error code'; choose silence"):
        plug.inject(WireFault("error code"))
    for kind in (*WIRE_FAULT_KINDS, *StarlightWheelMachine.own_faults):
        plug.inject(WireFault(kind))
    plug.clear_faults()


def test_buses_are_found_by_name(clock):
    backend = UsbBus(clock)
    assert register_bus("one", backend) == "simulated-here@one"
    assert bus("one") is backend
    unregister_bus("one")
    unregister_bus("one")
    with pytest.raises(LookupError, match="no simulated USB bus 'one'"):
        bus("one")


def test_a_wheel_turns_the_shorter_way_in_its_time():
    seen = []
    wheel = TurningWheel(6, 1, 0.5, on_slot=seen.append)
    wheel.turn_to(5, 10.0)
    assert wheel.reported_slot(10.4) == 0
    assert wheel.reported_slot(10.6) == 0
    assert wheel.reported_slot(11.0) == 5
    assert seen == [6, 5]
    wheel.stuck = True
    wheel.turn_to(1, 12.0)
    assert wheel.reported_slot(20.0) == 5
    wheel.stuck, wheel.never_arrives = False, True
    wheel.turn_to(6, 21.0)
    assert wheel.reported_slot(99.0) == 0
    wheel.never_arrives = False
    assert wheel.reported_slot(99.0) == 6


@pytest.mark.parametrize(
    "bad", [{"count": 0}, {"count": 3, "position": 4}, {"count": 3, "step": 0}]
)
def test_wheels_that_cannot_be_are_refused(bad):
    with pytest.raises(ValueError):
        TurningWheel(**bad)
