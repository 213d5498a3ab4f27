import subprocess
import sys

import pytest
from usb_benches import SEVEN, Bench

from drivers.errors import DeviceError
from drivers.starlight_wheel import StarlightWheel
from drivers.usb_link import UsbLink
from drivers.usb_link.backend import load_backend
from drivers.usb_link.error_messages import udev_rule
from simulator.machines.usb_wheels import StarlightWheelMachine
from simulator.wire.faults import WireFault


def link(bench, serial=""):
    return UsbLink("wheel", 0x1278, 0x0920, serial, bench.backend)


@pytest.fixture
def bench():
    with Bench(StarlightWheelMachine(serial="A")) as one:
        yield one


def test_who_is_given_up_lets_the_device_go(bench):
    wire = link(bench)
    wire.open()
    wire.cancel()
    for _ in range(2):
        with pytest.raises(DeviceError, match="ask: the device was given up"):
            wire.control_out("ask", 0x21, 9, 0x0200, b"\0\0")
        assert bench.plug.kernel_driver
    bench.plug.inject(WireFault("silence"))
    wire = link(bench)
    with pytest.raises(DeviceError):
        wire.open()
    bench.plug.clear_faults()
    wire.open()
    bench.plug.inject(WireFault("silence"))
    bench.plug._wait = lambda time: wire.cancel()
    with pytest.raises(DeviceError, match="ask: the device was given up"):
        wire.read("ask", 0x81, 2)
    assert bench.plug.kernel_driver


def test_the_system_gets_its_device_back(bench):
    wire = link(bench)
    wire.open()
    assert not bench.plug.kernel_driver
    assert wire.identity == ("Starlight Xpress", "SX Filter Wheel", "A", "1.00")
    wire.close()
    assert bench.plug.kernel_driver
    wire.close()


def test_a_denied_device_tells_the_rule_that_allows_it(bench):
    bench.plug.denied = True
    with pytest.raises(DeviceError) as caught:
        link(bench).open()
    assert "denies access" in str(caught.value)
    assert (
        'SUBSYSTEM=="usb", ATTR{idVendor}=="1278", ATTR{idProduct}=="0920", MODE="0660", '
        'TAG+="uaccess"'
    ) in caught.value.remedy
    assert caught.value.remedy == udev_rule(0x1278, 0x920)
    with pytest.raises(DeviceError, match="denies access"):
        link(bench, "A").open()


def test_a_device_in_use_is_named(bench):
    bench.plug.busy = True
    with pytest.raises(DeviceError, match=r"another program uses it\. End the other program"):
        link(bench).open()
    # And the system has it back.
    assert bench.plug.kernel_driver


def test_of_several_devices_the_serial_number_chooses(bench):
    bench.bus.plug_in(StarlightWheelMachine(serial="B"))
    with pytest.raises(DeviceError, match=r"2 USB devices 1278:0920 .* option serial"):
        link(bench).open()
    wire = link(bench, "B")
    wire.open()
    assert wire.identity.serial == "B"
    wire.close()
    with pytest.raises(DeviceError, match="no USB device 1278:0920 with serial number C"):
        link(bench, "C").open()


def test_a_missing_backend_is_explained(monkeypatch):
    monkeypatch.setitem(sys.modules, "libusb_package", None)
    with pytest.raises(DeviceError, match=r"pyusb has no backend\. Install .* libusb-package"):
        UsbLink("wheel", 0x1278, 0x0920).open()
    with pytest.raises(DeviceError, match=r"no simulated USB bus 'gone'.* Correct the option"):
        UsbLink("wheel", 1, 2, backend="simulated-here@gone").open()


def test_libusb_that_does_not_load_is_explained(monkeypatch):
    import libusb_package

    monkeypatch.setattr(libusb_package, "get_libusb1_backend", lambda: None)
    with pytest.raises(DeviceError, match=r"can't be loaded\. Reinstall"):
        UsbLink("wheel", 0x1278, 0x0920).open()


def test_with_the_real_libusb_a_missing_device_is_named():
    assert load_backend("") is not None
    with pytest.raises(DeviceError, match=r"no USB device 1278:0920 is there\. Plug it in"):
        UsbLink("wheel", 0x1278, 0x0920).open()


def test_a_stalled_endpoint_is_cleared(bench):
    wire = link(bench)
    wire.open()
    cleared = []
    bench.bus.clear_halt = lambda handle, endpoint: cleared.append(endpoint)
    bench.plug.inject(WireFault("stall"))
    with pytest.raises(DeviceError, match=r"it refuses the command \(stall\)"):
        wire.write("ask", 0x01, b"\0\0")
    assert cleared == [0x01]
    bench.plug.clear_faults()
    wire.write("ask", 0x01, b"\0\0")
    assert wire.read("ask", 0x81, 2) == b"\x01\x07"
    wire.close()


def test_silence_is_named_in_time(bench):
    wire = link(bench)
    wire.open()
    began = bench.clock.now()
    with pytest.raises(DeviceError, match=r"ask: no answer within 0\.3 s"):
        wire.read("ask", 0x81, 2, 0.3)
    assert bench.clock.now() - began == pytest.approx(0.3)
    assert wire.may_have_late_replies
    with pytest.raises(DeviceError, match="no answer within 1 s"):
        wire.read("ask", 0x81, 2, 77)
    wire.close()


def test_a_device_that_never_stops_sending_is_named(bench):
    from simulator.machines.usb import InputReport

    bench.machine.write = lambda endpoint, data, t: [InputReport(t, 0x81, b"\0\0")] * 500
    wire = link(bench)
    wire.write("ask", 0x01, b"\0\0")
    with pytest.raises(DeviceError, match="it doesn't stop sending"):
        wire.drain("ask", 0x81, 2, 0.01, lambda: True)
    assert wire.drain("ask", 0x81, 2, 0.01, lambda: False) == 499
    wire.close()


def test_more_than_was_asked_for_is_named(bench):
    from simulator.machines.usb import InputReport

    bench.machine.write = lambda endpoint, data, t: [InputReport(t, 0x81, b"\0" * 5)]
    wire = link(bench)
    wire.write("ask", 0x01, b"\0\0")
    with pytest.raises(DeviceError, match="it sent more than it was asked for"):
        wire.read("ask", 0x81, 2)
    wire.close()


def test_names_that_change_from_one_reading_to_the_next_are_refused(bench):
    bench.plug.inject(WireFault("bit flips"))
    bench.plug.inject(WireFault("garbage"))
    with pytest.raises(DeviceError, match="of itself"):
        link(bench).open()


def test_whatever_pyusb_raises_is_a_device_error(bench):
    wire = link(bench)
    wire.open()

    def broken(*given):
        raise NotImplementedError("intr_read")

    bench.bus.intr_read = broken
    with pytest.raises(DeviceError, match="NotImplementedError: intr_read"):
        wire.read("ask", 0x81, 2)


@pytest.mark.parametrize(
    "name",
    [
        "a b",
        "os:system",
        "os:system@touch x",
        "simulator.wire.usb_backend:bus@x",
        "nothing",
        "simulated@",
        5,
        None,
    ],
)
def test_what_is_no_name_of_an_installed_backend_is_refused(name):
    with pytest.raises(ValueError, match=r"backend is .* simulated-here"):
        UsbLink("wheel", 1, 2, backend=name)


def test_a_device_of_no_strings_is_one_all_the_same():
    with Bench(StarlightWheelMachine()) as bench:
        from dataclasses import replace

        bench.machine.description = replace(bench.machine.description, maker="", name="")
        wire = link(bench)
        wire.open()
        assert wire.identity == ("", "", "", "1.00")
        wire.close()


def test_importing_the_drivers_loads_no_usb():
    code = (
        "import drivers.starlight_wheel, drivers.zwo_wheel, drivers.uvc, sys; "
        "print([m for m in ('usb', 'cv2', 'libusb_package', 'simulator') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_many_openings_leave_nothing_behind(bench):
    for _ in range(20):
        with StarlightWheel(bench.surroundings, SEVEN, backend=bench.backend) as wheel:
            wheel.set_slot(2)
    assert bench.plug.kernel_driver


def test_an_unplugged_device_is_gone_without_a_word_to_it(bench):
    wire = link(bench)
    assert wire.unplugged_reason() is None
    wire.open()
    asked = list(bench.sent)
    assert wire.unplugged_reason() == ""
    bench.plug.inject(WireFault("disconnect", bench.clock.now()))
    assert wire.unplugged_reason() == "it was unplugged"
    bench.plug.clear_faults()
    assert wire.unplugged_reason() == ""
    assert bench.sent == asked


def test_of_two_alike_it_is_enough_that_one_goes(bench):
    other = bench.bus.plug_in(StarlightWheelMachine(serial="B"))
    wire = link(bench, "B")
    wire.open()
    assert wire.unplugged_reason() == ""
    other.inject(WireFault("disconnect", bench.clock.now()))
    assert wire.unplugged_reason() == "it was unplugged"
