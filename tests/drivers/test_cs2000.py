"""The CS-2000's driver, byte for byte and against its machine on a virtual clock."""

import math
import struct
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded import Bench

from drivers.cs2000 import CS2000
from drivers.errors import DeviceError
from drivers.interfaces import Spectroradiometer, Surroundings
from drivers.supervised import SupervisedDevice
from simulator.clock import VirtualClock
from simulator.machines.cs2000 import CS2000Machine
from simulator.machines.machine import Reply
from simulator.wire import plug_in


def light(wavelengths):
    """No two nanometres alike; some 60 cd/m²."""
    nm = wavelengths * 1e9
    return 2e5 * (1 + 0.5 * np.sin(nm / 23) + nm / 1000)


def never():
    return False


@pytest.fixture
def plugged():
    benches = []

    def plug(spectrum=light, **options):
        benches.append(bench := Bench(CS2000Machine(spectrum, **{"slit_nm": 0, **options})))
        return bench

    yield plug
    for bench in benches:
        bench.close()


def meter(bench, **options):
    return CS2000(bench.surroundings, bench.url, **options)


def asked(question, answer):
    """A question three times: the driver wants answers that agree."""
    return [(question + b"\r", answer + b"\r")] * 3


REST = [(b"\r", b"ER00\r"), (b"MEAS,0\r", b"ER00\r"), (b"RMTS,2\r", b"OK00\r")]
CHECK = [
    *asked(b"IDDR", b"OK00,CS-2000A ,2,1000123"),
    (b"MSWE,0\r", b"OK00\r"),
    *asked(b"NDFR", b"OK00,0"),
    *asked(b"LNSR", b"OK00,0"),
    *asked(b"SCMR", b"OK00,0"),
    *asked(b"SPMR", b"OK00,0,2"),
]


def test_opening_measuring_and_leaving_byte_for_byte(plugged):
    def told(block):
        values = light((380 + np.arange(*block)) * 1e-9) * 1e-9
        return "".join("," + struct.pack(">f", value).hex().upper() for value in values).encode()

    bench = plugged()
    with meter(bench) as device:
        assert bench.said() == REST + CHECK
        device.measure(never)
        talk = bench.said()
        spans = [(0, 100), (100, 200), (200, 300), (300, 401)]
        blocks = [
            (b"MEDR,1,1,%d\r" % number, b"OK00" + told(span) + b"\r")
            for number, span in enumerate(spans, start=1)
        ]
        conditions = talk[3][1]
        assert talk[:3] == [
            (b"MEAS,1\r", b"OK00,003\r"),
            (b"MEDR,0,0,1\r", b"ER02\rOK00\r"),
            (b"MEDR,0,0,1\r", conditions),
        ]
        assert conditions.startswith(b"OK00,0,0,0000")
        assert talk[3:6] == [(b"MEDR,0,0,1\r", conditions)] * 3
        assert talk[6:] == blocks * 2
    assert bench.said() == [(b"RMTS,0\r", b"OK00\r")]
    assert bench.machine.settings.remote == 0


def test_it_has_all_that_a_spectroradiometer_has(plugged):
    with meter(plugged()) as device:
        for name in [n for n in vars(Spectroradiometer) if not n.startswith("_")]:
            assert hasattr(device, name), name
        assert device.identity.model == "Konica Minolta CS-2000A"
        assert device.identity.serial == "1000123"
        assert not device.identity.simulated
        assert device.health() == {
            "serial number": "1000123", "measuring angle": "1°", "calibrated": "2024-02-01",
        }  # fmt: skip


def test_it_measures_the_light_that_is_there(plugged):
    bench = plugged()
    with meter(bench) as device:
        began = bench.clock.now()
        spectrum = device.measure(never)
        assert spectrum.wavelengths == pytest.approx(np.arange(380, 781) * 1e-9)
        assert spectrum.radiance == pytest.approx(light(spectrum.wavelengths), rel=1e-6)
        assert 0.005 < spectrum.integration_time < 1
        assert not spectrum.nd_filter_used
        assert spectrum.angle == pytest.approx(math.radians(1))
        assert began + 0.9 < spectrum.time < began + 1.5
        luminance = 683 * 1e-9 * (spectrum.radiance @ bright(spectrum.wavelengths * 1e9))
        assert device.tristimulus()[1] == pytest.approx(luminance, rel=0.02)


def bright(nm):
    """About what an eye sees of each wavelength."""
    return 1.019 * np.exp(-285.4 * (nm / 1000 - 0.559) ** 2)


def test_it_is_told_what_it_can_not_see(plugged):
    bench = plugged(angle=1)
    options = {
        "mode": "multi fast", "integration_s": 4, "nd": "on", "sync_hz": 60,
        "external_nd": "1/10", "close_up_lens": True,
    }  # fmt: skip
    with meter(bench, **options) as device:
        sent = [data for data, _ in bench.said()]
        for command in (b"NDFS,1\r", b"LNSS,1\r", b"SCMS,1,6000\r", b"SPMS,4,4,1\r"):
            assert sent.count(command) == 1
        spectrum = device.measure(never)
        assert spectrum.nd_filter_used
        assert spectrum.angle == pytest.approx(math.radians(0.2))
        assert bench.machine.settings.flash_write_count == 0
    assert meter(bench, mode="manual", integration_ms=7.5)._requested_settings.speed == "3,7500"


@pytest.mark.parametrize(
    ("model", "firmware", "said"),
    [
        ("CS-2000A", "3.00.0000", b"RMTS,1\r"),
        ("CS-2000A", "3.00.9301", b"RMTS,2\r"),
        ("CS-2000", "1.01.0000", b"RMTS,1\r"),
    ],
)
def test_its_flash_is_spared_where_firmware_can(plugged, model, firmware, said):
    bench = plugged(model=model, firmware=firmware)
    with meter(bench) as device:
        assert [data for data, _ in bench.said() if data.startswith(b"RMTS")][-1] == said
        assert device.measure(never).radiance.shape == (401,)
        assert bench.machine.settings.flash_write_count == 0


def test_a_long_measurement_is_waited_for_under_watch(plugged):
    bench = plugged(lambda w: light(w) * 1e-4)
    with SupervisedDevice("spectroradiometer", lambda: meter(bench)) as device:
        began = bench.clock.now()
        device.measure(never)
        assert 240 < bench.clock.now() - began < 260


@pytest.mark.parametrize("moment", [0.3, 1.5, 3.0])
def test_cancelled_it_ends_at_once_and_the_next_one_works(plugged, moment):
    bench = plugged()
    with meter(bench) as device:
        began = bench.clock.now()
        with pytest.raises(DeviceError, match=r"measure: it was cancelled"):
            device.measure(lambda: bench.clock.now() >= began + moment)
        assert bench.clock.now() < began + moment + 0.5
        again = device.measure(never)
        assert again.radiance == pytest.approx(light(again.wavelengths), rel=1e-6)


def test_escape_in_a_measurement_is_named(plugged):
    bench = plugged()
    with meter(bench) as device:
        pressed = []

        def press():
            if not pressed and bench.clock.now() > 3.5:
                pressed.append(True)
                bench.machine.press_escape()
            return False

        with pytest.raises(DeviceError, match="measure: "):
            device.measure(press)
        bench.machine.press_escape()
        assert device.measure(never).radiance.shape == (401,)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("stuck", r"its shutter fails \(ER81\)"),
        ("error code", r"its program failed \(ER99\)"),
        ("busy forever", r"it doesn't come to an end: 3 s were told"),
    ],
)
def test_what_goes_wrong_is_told_in_words(plugged, fault, said):
    bench = plugged()
    with meter(bench) as device:
        bench.suffer(fault)
        with pytest.raises(DeviceError, match=said):
            device.measure(never)
        bench.line.clear_faults()
        device.measure(never)


def test_light_that_is_too_bright_is_named(plugged):
    with (
        meter(plugged(lambda w: light(w) * 1000)) as device,
        pytest.raises(DeviceError, match=r"too bright.*\(ER10\).*smaller field"),
    ):
        device.measure(never)


def test_unplugged_in_a_measurement_it_is_named_at_once_and_found_again(plugged):
    bench = plugged()
    with meter(bench) as device:
        bench.suffer("disconnect", after=2.0, seconds=3.0)
        with pytest.raises(DeviceError, match=r"port sim://bench.*disconnected"):
            device.measure(never)
        assert bench.clock.now() < 5
        bench.clock.wait_until(bench.clock.now() + 5, never)
        device.measure(never)


def test_another_instrument_at_its_port_is_named(plugged):
    bench = plugged()
    with meter(bench) as device:
        bench.suffer("disconnect", seconds=1.0)
        with pytest.raises(DeviceError):
            device.health()
        bench.line.machine = CS2000Machine(light, serial="7654321")
        bench.clock.wait_until(bench.clock.now() + 2, never)
        with pytest.raises(DeviceError, match="number 7654321, not 1000123"):
            device.health()


@pytest.mark.parametrize(
    ("digits", "said"),
    [
        ("D1BA43B6", "couldn't compute a value"),
        ("7F800000", "what is no number"),
        ("7FC00000", "what is no number"),
        ("7E967699", r"the radiance is from .* to 1e\+38"),
        ("C0000000", "the radiance is from -2"),
        ("3A0DAG51", "what is no number"),
        ("3A0DA5", "block 3 has 100 values"),
    ],
)
def test_a_value_that_can_not_be_is_never_taken(plugged, digits, said):
    class Wrong(CS2000Machine):
        def feed(self, data, t):
            replies = super().feed(data, t)
            return [
                Reply(r.at, r.data[:5] + digits.encode() + r.data[13:])
                if len(r.data) == 905 and r.data[5:13] == self.third
                else r
                for r in replies
            ]

        third = struct.pack(">f", light(np.array([580e-9]))[0] * 1e-9).hex().upper().encode()

    bench = plugged()
    bench.line.machine = Wrong(light, slit_nm=0)
    with meter(bench) as device, pytest.raises(DeviceError, match=said):
        device.measure(never)


def test_killed_a_measurement_ends(plugged):
    bench = plugged()
    slow = VirtualClock(speed=20)
    bench.surroundings = Surroundings(slow)
    plug_in("bench", bench.line, slow)
    with meter(bench) as device:
        timer = threading.Timer(0.1, device.kill)
        timer.start()
        with pytest.raises(DeviceError, match="given up"):
            device.measure(never)
        timer.join()


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ({"port": ""}, "port is ''"),
        ({"baudrate": 300}, "baudrate is 300; choose 600"),
        ({"baudrate": True}, "baudrate is True"),
        ({"mode": "slow"}, "mode is 'slow'; choose normal, fast"),
        ({"mode": []}, "mode is"),
        ({"nd": "maybe"}, "nd is 'maybe'"),
        ({"mode": "manual", "integration_ms": 10, "nd": "auto"}, "nd is 'auto'; choose off, on"),
        ({"mode": "manual"}, "integration_ms is None and mode 'manual'"),
        ({"integration_ms": 10}, "integration_ms is 10 and mode 'normal'"),
        ({"mode": "manual", "integration_ms": 4.9}, "integration_ms is 4.9; it must be"),
        ({"mode": "manual", "integration_ms": math.nan}, "integration_ms is nan"),
        ({"mode": "manual", "integration_ms": "7"}, "integration_ms is '7'"),
        ({"mode": "multi"}, "integration_s is None and mode 'multi'"),
        ({"mode": "multi", "integration_s": 17}, "integration_s is 17"),
        ({"mode": "multi", "integration_s": 1.5}, "integration_s is 1.5"),
        ({"sync_hz": 10}, "sync_hz is 10"),
        ({"sync_hz": 60, "external_sync": True}, "sync_hz is 60 and external_sync True"),
        ({"sync_hz": math.nan}, "sync_hz is nan"),
        ({"external_sync": 1}, "external_sync is 1"),
        ({"external_nd": "1/1000"}, "external_nd is '1/1000'"),
        ({"close_up_lens": None}, "close_up_lens is None"),
        ({"rtscts": "yes"}, "rtscts is 'yes'"),
    ],
)
def test_bad_options_are_named(option, said):
    with pytest.raises(ValueError, match=said):
        CS2000(Surroundings(VirtualClock()), **{"port": "x", **option})


class Chatter:
    """Says one thing to everything."""

    own_faults = ()

    def __init__(self, says):
        self.says = says

    def feed(self, data, t):
        return [Reply(t + 0.01, self.says)] if data == b"\r" and self.says else []

    def set_fault(self, kind):
        pass


@settings(max_examples=30, deadline=None)
@given(
    st.binary(max_size=60).map(lambda noise: noise + b"\r")
    | st.from_regex(rb"\A(OK|ER)[0-9]{2}(,[0-9A-Z -]{0,9}){0,4}\r\Z")
    | st.binary(max_size=60)
)
def test_whatever_it_says_it_is_no_spectroradiometer(noise):
    bench = Bench(Chatter(noise))
    try:
        with pytest.raises(DeviceError), meter(bench):
            pass
        assert bench.clock.now() < 35
    finally:
        bench.close()
