"""Whatever goes wrong with a camera: the right frame or a named error, in time, and on it goes."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from coded_pictures import (
    SHAPE,
    AtThirdLook,
    assert_shows,
    camera,
    exposure_of,
    fake_camera,
    never,
    outcome,
    picture,
)

from drivers.aravis import AravisCamera
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Frame, Surroundings
from drivers.supervised import SupervisedCamera
from simulator.wire.fake_gige import (
    CAMERA_FAULT_KINDS,
    CameraFault,
    CameraFaultKind,
    FakeGigECamera,
)

pytestmark = pytest.mark.aravis

PATIENCE = 60.0
"""Seconds after which what should have come long ago is given up."""

LOST = "no word from it for 0.8 s|control was lost"


@pytest.fixture(scope="module")
def fake() -> Iterator[FakeGigECamera]:
    with fake_camera("Mono12p") as fake:
        yield fake


@pytest.fixture(autouse=True)
def no_fault_stays(fake: FakeGigECamera) -> Iterator[None]:
    yield
    fake.clear_faults()


@pytest.fixture
def driver() -> AravisCamera:
    return camera(frame_timeout_ms=300, packet_size=576)


@pytest.fixture
def opened(fake: FakeGigECamera, driver: AravisCamera) -> Iterator[SupervisedCamera]:
    """Under watch: a call that takes longer than its documented time says that it hangs."""
    with SupervisedCamera("camera", lambda: driver) as device:
        device.set_exposure(2e-3)
        yield device


def bad_frames(driver: AravisCamera) -> int:
    return sum(driver.counts[name] for name in ("missing", "corrupt", "incomplete"))


@pytest.mark.parametrize("kind", CAMERA_FAULT_KINDS)
def test_capture_gives_the_right_frame_or_names_what_is_wrong(
    fake: FakeGigECamera, opened: SupervisedCamera, kind: CameraFaultKind
) -> None:
    opened.capture(never)
    fake.inject(CameraFault(kind))
    result = outcome(lambda: opened.capture(never))
    assert not opened.failure_reason
    if isinstance(result, DeviceError):
        assert "Aravis Fake" in str(result)
    else:
        assert_shows(result.image, picture(result.exposure))
    fake.clear_faults()
    opened.set_exposure(3e-3)
    assert_shows(opened.capture(never).image, picture(3e-3))


@pytest.mark.parametrize("kind", CAMERA_FAULT_KINDS)
def test_an_exposure_is_set_or_the_fault_is_named(
    fake: FakeGigECamera, opened: SupervisedCamera, kind: CameraFaultKind
) -> None:
    fake.inject(CameraFault(kind))
    result = outcome(lambda: opened.set_exposure(4e-3))
    assert not opened.failure_reason
    if not isinstance(result, DeviceError):
        assert result.actual == pytest.approx(4e-3)
    fake.clear_faults()
    opened.set_exposure(5e-3)
    assert exposure_of(opened.capture(never).image) == pytest.approx(5e-3)


@pytest.mark.parametrize(
    ("kind", "named"),
    [
        ("lost packets", "(incomplete|missing) frame: "),
        ("missing frame", "missing frame: no frame within"),
        ("late frame", "missing frame: no frame within"),
        ("corrupt frame", "corrupt frame: number .* not"),
        ("wrong exposure", "wrong exposure frame: the camera exposes"),
        ("stopped stream", "missing frame: no frame within"),
        ("silence", "no word from it for 0.8 s"),
        ("disconnect", "no word from it for 0.8 s"),
        ("heartbeat loss", "control was lost"),
    ],
)
def test_a_lasting_fault_has_a_name(
    fake: FakeGigECamera, opened: SupervisedCamera, kind: CameraFaultKind, named: str
) -> None:
    opened.capture(never)
    fake.inject(CameraFault(kind))
    with pytest.raises(DeviceError, match=named):
        opened.capture(never)


@pytest.mark.parametrize("kind", ["missing frame", "corrupt frame", "lost packets"])
def test_a_passing_fault_costs_time_only(
    fake: FakeGigECamera, opened: SupervisedCamera, driver: AravisCamera, kind: CameraFaultKind
) -> None:
    opened.capture(never)
    before = bad_frames(driver)
    fake.inject(CameraFault(kind))

    def mends_what_was_seen() -> bool:
        if bad_frames(driver) > before:
            fake.clear_faults()
        return False

    assert_shows(driver.capture(mends_what_was_seen).image, picture(2e-3))
    assert bad_frames(driver) > before


@pytest.mark.parametrize("kind", ["disconnect", "silence", "heartbeat loss"])
def test_a_lost_camera_is_noticed_within_an_exposure(
    fake: FakeGigECamera, opened: SupervisedCamera, driver: AravisCamera, kind: CameraFaultKind
) -> None:
    """After it, a frame would be missing."""
    opened.set_exposure(20.0)
    struck = AtThirdLook(lambda: fake.inject(CameraFault(kind)))
    with pytest.raises(DeviceError, match=LOST):
        driver.capture(lambda: struck() and False)
    fake.clear_faults()
    opened.set_exposure(1e-3)
    assert_shows(opened.capture(never).image, picture(1e-3))


def test_it_is_opened_as_it_was_set(fake: FakeGigECamera) -> None:
    with camera(gain_db=3.0, roi=[4, 2, 16, 12], pixel_format="Mono16") as device:
        device.set_exposure(7e-3)
        fake.inject(CameraFault("disconnect"))
        outcome(lambda: device.capture(never))
        fake.clear_faults()
        frame: Frame = device.capture(never)
        assert device.pixel_format == "Mono16"
    assert_shows(frame.image, picture(7e-3, 3.0)[2:14, 4:20])


def test_a_supervisor_sees_it_through_an_unplugged_cable(fake: FakeGigECamera) -> None:
    def make() -> AravisCamera:
        return AravisCamera(Surroundings(RealClock()), "127.0.0.1")

    with SupervisedCamera("camera", make) as device:
        device.set_exposure(1e-3)
        fake.inject(CameraFault("disconnect"))
        with pytest.raises(DeviceError, match="no word"):
            device.capture(never)
        fake.clear_faults()
        assert exposure_of(device.capture(never).image) == pytest.approx(1e-3)
        assert not device.failure_reason


@pytest.mark.parametrize(
    "latency", [0, 3, *(pytest.param(one, marks=pytest.mark.sweep) for one in (1, 8))]
)
@pytest.mark.parametrize("trigger", ["software", "free"])
def test_no_frame_of_a_bracket_has_another_exposure(
    fake: FakeGigECamera, latency: int, trigger: str
) -> None:
    fake.set_latency(latency)
    rng = np.random.default_rng(latency)
    with camera(trigger=trigger, frame_rate=100.0 if trigger == "free" else 0.0) as device:
        for exposure in 0.5e-3 * 1.5 ** np.arange(8):
            actual = device.set_exposure(float(exposure)).actual
            time.sleep(rng.choice([0.0, 0.0, 0.05, 0.2]))
            frame = device.capture(never)
            assert exposure_of(frame.image) == pytest.approx(actual, abs=1e-9)
    fake.set_latency(0)


def test_a_hardware_trigger_is_waited_for(fake: FakeGigECamera) -> None:
    import threading

    with camera(trigger="hardware", latency_frames=0, trigger_wait_s=1.0) as device:
        device.set_exposure(1e-3)
        with pytest.raises(DeviceError, match="no trigger at Line0, or no frame, within"):
            device.capture(never)
        stop = threading.Event()

        def pulses() -> None:
            while not stop.wait(0.05):
                fake.pulse()

        thread = threading.Thread(target=pulses)
        thread.start()
        try:
            assert_shows(device.capture(never).image, picture(1e-3))
        finally:
            stop.set()
            thread.join()


def test_frames_that_were_dropped_are_counted(fake: FakeGigECamera) -> None:
    with camera(trigger="free", frame_rate=100.0, latency_frames=0) as device:
        device.set_exposure(1e-3)
        first = device.next_frame(never)
        fake.inject(CameraFault("missing frame"))
        time.sleep(0.2)
        fake.clear_faults()
        numbers = [first.number]
        while len(numbers) < 30:
            numbers.append(device.next_frame(never).number)
        gone = numbers[-1] - numbers[0] + 1 - len(numbers)
        bad = sum(device.counts[name] for name in ("dropped", "incomplete", "missing"))
        assert gone == bad > 5


def capture_twice(device: SupervisedCamera) -> None:
    """Where a fault begins, one good frame may be on its way already."""
    for _ in range(2):
        device.capture(never)


@pytest.mark.parametrize("kind", ["lost packets", "corrupt frame", "missing frame"])
def test_a_running_camera_without_a_good_frame_is_named_and_cancelled(
    fake: FakeGigECamera, kind: CameraFaultKind
) -> None:
    options = {"packet_size": 576, "frame_timeout_ms": 300, "latency_frames": 0}
    driver = camera(trigger="free", frame_rate=50.0, **options)
    with SupervisedCamera("camera", lambda: driver) as device:
        device.set_exposure(1e-3)
        device.capture(never)
        fake.inject(CameraFault(kind))
        with pytest.raises(DeviceError, match="missing frame: no "):
            capture_twice(device)
        cancelled = AtThirdLook()
        with pytest.raises(DeviceError, match="it was cancelled"):
            driver.capture(cancelled)
        assert cancelled.looks == 3
        fake.clear_faults()
        assert_shows(device.capture(never).image, picture(1e-3))


def test_binning_is_set_and_seen(fake: FakeGigECamera) -> None:
    with camera(binning=[2, 2]) as device:
        assert device.shape == (SHAPE[0] // 2, SHAPE[1] // 2)
        device.set_exposure(1e-3)
        means = picture(1e-3).reshape(SHAPE[0] // 2, 2, SHAPE[1] // 2, 2).mean(axis=(1, 3))
        np.testing.assert_allclose(device.capture(never).image, means, atol=1.5)


@pytest.mark.parametrize("kind", ["disconnect", "silence", "heartbeat loss"])
def test_a_camera_that_nobody_asks_is_gone_by_itself(
    fake: FakeGigECamera, opened: SupervisedCamera, kind: CameraFaultKind
) -> None:
    opened.capture(never)
    assert opened.unplugged_reason() == ""
    fake.inject(CameraFault(kind))
    late = time.monotonic() + PATIENCE
    while not opened.unplugged_reason():
        assert time.monotonic() < late
        time.sleep(0.02)
    fake.clear_faults()
    with pytest.raises(DeviceError, match=LOST):
        opened.set_exposure(3e-3)
    assert opened.unplugged_reason() is None
    opened.set_exposure(3e-3)
    assert_shows(opened.capture(never).image, picture(3e-3))
    assert opened.unplugged_reason() == ""
