"""The driver of GigE Vision cameras and Aravis' fake camera, packet by packet."""

from __future__ import annotations

import os
import signal
import socket
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
from judges.wired_state import camera_register

from drivers.aravis import AravisCamera, find_cameras
from drivers.aravis.applied_settings import AppliedSettings
from drivers.aravis.pixel_formats import FORMATS
from drivers.device_holders import name_process
from drivers.errors import DeviceError
from drivers.ports import cameras
from simulator.wire.fake_gige import FakeGigECamera

pytestmark = pytest.mark.aravis


@pytest.fixture(scope="module")
def fake() -> Iterator[FakeGigECamera]:
    with fake_camera() as fake:
        yield fake


@pytest.fixture
def opened(fake: FakeGigECamera) -> Iterator[AravisCamera]:
    with camera() as device:
        yield device


def test_it_tells_what_it_is_and_can(opened: AravisCamera) -> None:
    assert opened.identity.model == "Aravis Fake"
    assert opened.identity.serial == "SIM01"
    assert not opened.identity.simulated
    assert opened.shape == SHAPE
    assert opened.full_scale == 255
    assert opened.exposure_range == pytest.approx((10e-6, 60.0))
    assert opened.gain_range == (0.0, 48.0)


def test_health_names_protocol_temperature_and_counts(opened: AravisCamera) -> None:
    opened.capture(never)
    told = opened.health()
    assert told["protocol"] == "GigE Vision"
    assert told["DeviceTemperature"] == "41.5"
    assert told["missing packets"] == "0"


def test_each_frame_is_of_the_exposure_that_was_set(opened: AravisCamera) -> None:
    for exposure in (1e-3, 5e-3, 2e-3, 2e-3):
        setting = opened.set_exposure(exposure)
        frame = opened.capture(never)
        assert setting.actual == frame.exposure == pytest.approx(exposure)
        assert_shows(frame.image, picture(exposure))


def test_exposures_are_quantised_and_the_quantised_one_is_told(opened: AravisCamera) -> None:
    setting = opened.set_exposure(1.2346e-3 + 4e-7)
    frame = opened.capture(never)
    assert setting.actual == frame.exposure == pytest.approx(1.235e-3, abs=1e-9)
    assert exposure_of(frame.image) == pytest.approx(setting.actual)


def test_frames_are_counted_and_none_of_the_first_ones_is_taken(opened: AravisCamera) -> None:
    before = opened.counts["thrown away"]
    opened.set_exposure(1.7e-3)
    first, second = opened.capture(never), opened.capture(never)
    assert second.number == first.number + 1
    assert second.time >= first.time + 1e-3
    assert before + 3 <= opened.counts["thrown away"] <= before + 8
    opened.set_exposure(1e-3)


def test_gain_reaches_the_pixels_and_the_frame(opened: AravisCamera) -> None:
    opened.set_exposure(1e-3)
    assert opened.set_gain(6.0).actual == pytest.approx(6.0)
    frame = opened.capture(never)
    assert frame.gain == pytest.approx(10 ** (-6 / 20))
    assert_shows(frame.image, picture(1e-3, 6.0))
    opened.set_gain(0.0)


@pytest.mark.parametrize("exposure", [1e-6, 61.0])
def test_an_exposure_out_of_range_is_refused(opened: AravisCamera, exposure: float) -> None:
    with pytest.raises(DeviceError, match=r"out of range, 0.01 to 60000 ms"):
        opened.set_exposure(exposure)


@pytest.mark.timeout(40)
def test_a_long_exposure_is_cancelled_at_once_and_the_next_one_is_good(
    opened: AravisCamera,
) -> None:
    """It would last longer than this test may."""
    opened.set_exposure(60.0)
    cancelled = AtThirdLook()
    assert "it was cancelled" in str(outcome(lambda: opened.capture(cancelled)))
    assert cancelled.looks == 3
    opened.set_exposure(2e-3)
    assert exposure_of(opened.capture(never).image) == pytest.approx(2e-3)


def test_a_killed_library_is_named_and_started_again(opened: AravisCamera) -> None:
    opened.set_exposure(3e-3)
    opened.kill()
    error = outcome(lambda: opened.capture(never))
    # Nobody has waited for an answer.
    assert "its process ended" in str(error)
    frame = opened.capture(never)
    assert exposure_of(frame.image) == pytest.approx(3e-3)


@pytest.mark.parametrize("address", ["SIM01", "Aravis-Fake-SIM01", ""])
def test_it_is_found_by_serial_number_and_id(fake: FakeGigECamera, address: str) -> None:
    with camera(address=address) as device:
        assert device.identity.serial == "SIM01"


def test_what_is_there_is_listed(fake: FakeGigECamera) -> None:
    assert "SIM01" in [one["serial"] for one in find_cameras()]
    assert [port.address for port in cameras()] == ["Aravis-Fake-SIM01"]
    with pytest.raises(DeviceError, match=r"can't be opened.*Give one of: Aravis-Fake-SIM01"):
        camera(address="NOBODY").__enter__()


@pytest.mark.parametrize("name", list(FORMATS))
def test_frames_of_every_format_are_what_was_sent(fake: FakeGigECamera, name: str) -> None:
    with camera(pixel_format=name, latency_frames=0) as device:
        device.set_exposure(1e-3)
        frame = device.capture(never)
        assert device.pixel_format == name
        assert device.bayer == FORMATS[name].bayer
    assert_shows(frame.image, picture(1e-3))


def test_a_camera_that_somebody_has_is_named(fake: FakeGigECamera, opened: AravisCamera) -> None:
    assert "somebody else has it open" in str(outcome(camera().__enter__))


def test_a_camera_whose_process_was_killed_is_stopped_and_released(fake: FakeGigECamera) -> None:
    """As its registers tell, which are asked over the network."""
    running, controller = 0x124, 0xA00
    with camera() as device:
        device.set_exposure(1e-3)
        device.capture(never)
        assert camera_register("127.0.0.1", running) == 1
        assert device._link is not None
        os.kill(device._link._process.pid, signal.SIGKILL)
        device.make_safe()
        assert camera_register("127.0.0.1", running) == 0
    assert camera_register("127.0.0.1", controller) == 0


def test_who_has_a_camera_that_tells_its_controller_is_named(
    fake: FakeGigECamera, opened: AravisCamera
) -> None:
    """By the registers of GigE Vision that tell the controller's address and port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as controller:
        controller.bind(("127.0.0.1", 0))
        told = [(0x0A14, 0x7F000001), (0x0A04, controller.getsockname()[1])]
        fake._send_request("write_registers", told)
        try:
            words = str(outcome(camera().__enter__))
        finally:
            fake._send_request("write_registers", [(0x0A14, 0), (0x0A04, 0)])
    assert f"in use by {name_process(os.getpid())}. Close that first" in words


def test_a_run_chooses_region_binning_and_gain_and_leaves_the_camera_as_it_was(
    opened: AravisCamera,
) -> None:
    opened.set_exposure(2e-3)
    assert opened.set_region((16, 8, 64, 32), None).actual == (16, 8, 64, 32)
    assert opened.shape == (32, 64)
    assert_shows(opened.capture(never).image, picture(2e-3)[8:40, 16:80])
    assert opened.set_gain(12.0).actual == opened.gain_db == 12.0
    loud = opened.capture(never)
    assert_shows(loud.image, picture(2e-3, 12.0)[8:40, 16:80])
    opened.set_region((16, 8, 64, 32), 2)
    opened.set_exposure(2e-3)
    binned = opened.capture(never)
    blocks = picture(2e-3, 12.0)[8:40, 16:80].reshape(16, 2, 32, 2).mean(axis=(1, 3))
    # The lowest bit differs from frame to frame, and the mean is rounded.
    assert np.abs(binned.image - blocks).max() <= 1.5
    assert binned.gain == pytest.approx(4 * loud.gain)
    opened.make_safe()
    assert opened.shape == SHAPE
    assert opened.gain_db == 0
    assert_shows(opened.capture(never).image, picture(2e-3))


def test_binning_beside_the_options_is_refused_by_name(fake: FakeGigECamera) -> None:
    with camera(binning=(2, 2)) as device:
        with pytest.raises(DeviceError, match="option binning"):
            device.set_region(None, 2)
        assert device.capture(never).image.shape == (SHAPE[0] // 2, SHAPE[1] // 2)


def test_a_region_that_was_refused_is_never_said_to_be_set(
    opened: AravisCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(settings: AppliedSettings) -> list[int]:
        raise DeviceError("camera", "roi", "it has set another one", "Give one it can set")

    opened.set_exposure(2e-3)
    with monkeypatch.context() as patch:
        patch.setattr(AppliedSettings, "_set_region", refuse)
        for _ in range(2):
            with pytest.raises(DeviceError, match="another one"):
                opened.set_region((16, 8, 64, 32), None)
    assert_shows(opened.capture(never).image, picture(2e-3))
    opened.set_region((16, 8, 64, 32), None)
    assert_shows(opened.capture(never).image, picture(2e-3)[8:40, 16:80])
