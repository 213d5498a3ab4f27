import contextlib
import os
import random
import threading
import time

import cv2
import numpy as np
import pytest
from uvc_camera_machine import UvcCameraMachine

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.hosted import HostedDevice
from drivers.interfaces import Camera, Device, Surroundings
from drivers.latency import count_old_frames
from drivers.supervised import SupervisedCamera
from drivers.uvc import UVCCamera
from drivers.uvc.camera import UVCTiming
from drivers.uvc.pixel_decoding import decode_pixels

UNIT = 1e-4

BRACKETS = int(os.environ.get("BRACKETS", "2"))
MOMENTS = int(os.environ.get("FAULT_MOMENTS", "1"))
PAUSE = float(os.environ.get("READER_PAUSE_S", "0.1"))


def never():
    return False


def coded(exposure):
    """A picture that tells its exposure, in units of 100 us."""
    return np.full((4, 6), round(exposure / UNIT))


def machine(**options):
    given = {"frame_rate": 250.0, "pixel_format": "Y16 ", "width": 6, "height": 4} | options
    return UvcCameraMachine(coded, **given)


def camera(behind, **options):
    given = {"width": 6, "height": 4, "pixel_format": "Y16 ", "source": behind.source} | options
    return UVCCamera(Surroundings(RealClock()), **given)


def test_it_is_a_camera_that_says_who_it_is():
    with camera(machine()) as one:
        for protocol in (Camera, Device):
            for name in [n for n in vars(protocol) if not n.startswith("_")]:
                assert hasattr(one, name), name
        assert (one.shape, one.full_scale) == ((4, 6), 65535)
        assert one.identity.model == "UVC camera"
        assert not one.identity.simulated
        assert one.health()["backend"] == "V4L2"


def test_all_that_changes_pictures_by_itself_is_switched_off():
    behind = machine()
    with camera(behind, gain=12.0):
        assert behind.settings[cv2.CAP_PROP_AUTO_EXPOSURE] == 1
        assert behind.settings[cv2.CAP_PROP_AUTO_WB] == 0
        assert behind.settings[cv2.CAP_PROP_AUTOFOCUS] == 0
        assert behind.settings[cv2.CAP_PROP_CONVERT_RGB] == 0
        assert behind.settings[cv2.CAP_PROP_GAIN] == 12


def test_exposures_are_set_in_units_of_100_us_and_read_back():
    behind = machine()
    with camera(behind) as one:
        setting = one.set_exposure(1.234e-3)
        assert setting.request == 1.234e-3
        assert setting.actual == pytest.approx(1.2e-3)
        # No more digits than the plan has: 5 ms are 5 ms.
        assert one.set_exposure(5e-3).actual == 5e-3
        one.set_exposure(1.234e-3)
        assert behind.settings[cv2.CAP_PROP_EXPOSURE] == 12
        with pytest.raises(DeviceError, match=r"out of range, 0\.1 to 500 ms"):
            one.set_exposure(1.0)
        assert one.set_exposure(1e-4).actual == pytest.approx(1e-4)


@pytest.mark.parametrize("latency", [0, 1, 2, 3])
@pytest.mark.parametrize("stamped", [True, False])
def test_no_frame_of_another_exposure_is_taken(latency, stamped):
    behind = machine(latency=latency, stamped=stamped)
    chance = random.Random(latency)
    with camera(behind, discard_frames=latency, exposure_range_ms=(0.1, 20)) as one:
        for exposure in [1e-3, 3e-3, 5e-4, 8e-3] * 2:
            actual = one.set_exposure(exposure).actual
            if chance.random() < 0.5:
                time.sleep(chance.random() * 0.03)
            frame = one.capture(never)
            assert frame.exposure == actual
            assert frame.image.dtype == np.uint16
            assert frame.image[0, 0] == round(actual / UNIT)


def test_a_reader_that_was_held_up_takes_no_stale_frame():
    """The stream's thread pauses, the queue fills, the scene and the exposure change."""
    behind = machine(latency=1, frame_rate=100.0)
    scene = [0]
    behind.expose = lambda exposure: np.full((4, 6), round(exposure / UNIT) + scene[0])
    with camera(behind, discard_frames=1) as one:
        held = threading.Event()
        take = behind.take

        def slow():
            while held.is_set():
                time.sleep(0.005)
            return take()

        behind.take = slow
        for number, exposure in enumerate([2e-3, 4e-3, 1e-3], start=1):
            one.set_exposure(exposure)
            held.set()
            threading.Timer(0.15, held.clear).start()
            frame = one.capture(never)
            assert frame.image[0, 0] == round(exposure / UNIT) + scene[0]
            scene[0] = 1000 * number


@pytest.mark.parametrize("latency", [0, 1, 2, 3])
def test_brackets_hold_no_frame_of_another_exposure(latency):
    """Eight exposures, again and again, while the stream's thread is held up now and then."""
    behind = machine(latency=latency, frame_rate=100.0)
    chance, take = random.Random(latency), behind.take

    def slow():
        if chance.random() < 0.03:
            time.sleep(chance.random() * PAUSE)
        return take()

    behind.take = slow
    with camera(behind, discard_frames=latency) as one:
        for _ in range(BRACKETS):
            for units in (1, 2, 4, 8, 16, 32, 64, 128):
                actual = one.set_exposure(units * UNIT).actual
                frame = one.capture(never)
                assert frame.exposure == actual
                assert frame.image[0, 0] == units


def test_a_frame_is_begun_after_it_was_asked_for():
    with camera(machine(frame_rate=50.0)) as one:
        one.set_exposure(5e-3)
        clock = one._clock
        for _ in range(3):
            asked = clock.now()
            frame = one.capture(never)
            assert asked <= frame.time <= clock.now()
        assert one.capture(never).number > frame.number


@pytest.mark.parametrize("latency", [0, 2, 3])
def test_the_latency_is_measured_by_steps_of_the_exposure(latency):
    behind = machine(latency=latency, frame_rate=100.0)
    with camera(behind) as one:
        found = one.measure_latency((1e-3, 4e-3), steps=2)
        # Besides those of the camera's own, the one that was being exposed.
        assert latency <= found <= latency + 2
        assert one.discard_frames == found
        for exposure in (1e-3, 8e-3, 2e-3):
            one.set_exposure(exposure)
            assert one.capture(never).image[0, 0] == round(exposure / UNIT)


def test_a_light_that_shows_no_step_is_said():
    behind = machine()
    behind.expose = lambda exposure: np.full((4, 6), 200)
    with camera(behind, discard_frames=2) as one:
        with pytest.raises(DeviceError, match="give two exposures that differ more"):
            one.measure_latency((1e-3, 4e-3), steps=1)
        assert one.discard_frames == 2


def test_latencies_of_levels():
    step = [(0, 10.0), (1, 10.0), (2, 25.0), *[(i, 40.0) for i in range(3, 12)]]
    assert count_old_frames(10.0, step) == 3
    assert count_old_frames(10.0, [(i, 40.0) for i in range(12)]) == 0
    with pytest.raises(ValueError, match="too few"):
        count_old_frames(10.0, step[:5])
    with pytest.raises(ValueError, match="don't settle"):
        count_old_frames(10.0, [(i, 40.0 * (1 + i % 2)) for i in range(12)])


def test_a_stream_that_stops_is_named_within_a_second_and_begins_again(monkeypatch):
    """A second has 50 looks at whether the wait was cancelled. The system says nothing by then."""
    monkeypatch.setattr("uvc_camera_machine._SELECT", 10.0)
    behind, looks = machine(), []
    with camera(behind) as one:
        one.set_exposure(2e-3)
        behind.fault = "stopped stream"
        with pytest.raises(DeviceError, match="capture: the stream has stopped"):
            one.capture(lambda: looks.append(1))
        assert 1 < len(looks) <= 50
        behind.fault = ""
        assert one.capture(never).image[0, 0] == 20
        assert behind.opened == 2


def test_an_unplugged_camera_is_named_and_found_again_with_its_exposure():
    behind = machine()
    with camera(behind) as one:
        one.set_exposure(3e-3)
        behind.fault = "disconnect"
        with pytest.raises(DeviceError, match="the stream broke off"):
            one.capture(never)
        with pytest.raises(DeviceError, match="in use by another program, or is no camera"):
            one.capture(never)
        behind.settings[cv2.CAP_PROP_EXPOSURE] = 500.0
        behind.fault = ""
        frame = one.capture(never)
        assert frame.exposure == pytest.approx(3e-3)
        assert frame.image[0, 0] == 30


def test_a_camera_that_hangs_is_named():
    behind = machine()
    with camera(behind) as one:
        one.set_exposure(2e-3)
        behind.fault = "hang"
        with pytest.raises(DeviceError, match="the stream has stopped"):
            one.capture(never)
        with pytest.raises(DeviceError, match="it hangs in the system"):
            one.capture(never)
        behind.fault = ""
        assert one.capture(never).image[0, 0] == 20


def test_an_exposure_that_the_frame_rate_cuts_short_is_said():
    with camera(machine(frame_rate=100.0, slows_down=False)) as one:
        one.set_exposure(8e-3)
        assert one.capture(never).image[0, 0] == 80
        one.set_exposure(40e-3)
        with pytest.raises(DeviceError, match=r"come every 10 ms, so that none is exposed for 40"):
            one.capture(never)
        one.set_exposure(5e-3)
        assert one.capture(never).image[0, 0] == 50


def test_a_camera_whose_file_has_gone_was_unplugged(tmp_path):
    path = tmp_path / "video0"
    path.touch()
    behind = machine()
    with camera(behind, device=str(path)) as one:
        path.unlink()
        behind.fault = "disconnect"
        with pytest.raises(DeviceError, match=r"it was unplugged\. Plug it in again"):
            one.capture(never)


COMMANDS = {
    "capture": lambda one: one.capture(never),
    "set exposure": lambda one: one.set_exposure(5e-3),
    "health": lambda one: one.health(),
    "make safe": lambda one: one.make_safe(),
}


@contextlib.contextmanager
def hurried(monkeypatch):
    """Faults are waited for a fifth of a second here; a machine that is busy may need longer."""
    with monkeypatch.context() as patch:
        patch.setattr("drivers.uvc.camera._TIMING", UVCTiming(0.2, 0.2))
        patch.setattr("drivers.uvc.camera_connection._STOP_TIMEOUT", 0.2)
        patch.setattr("uvc_camera_machine._SELECT", 0.2)
        yield


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("fault", ["stopped stream", "disconnect", "hang"])
def test_every_command_under_every_fault_is_right_or_a_device_error(monkeypatch, fault, name):
    """Under watch: a command that takes longer than its documented time leaves a dead device."""
    behind = machine()
    with SupervisedCamera("camera", lambda: camera(behind)) as one:
        one.set_exposure(2e-3)
        for _ in range(MOMENTS):
            strike = threading.Timer(random.random() * 0.02, setattr, (behind, "fault", fault))
            strike.start()
            with hurried(monkeypatch), contextlib.suppress(DeviceError):
                answer = COMMANDS[name](one)
                if name == "capture":
                    assert answer.image[0, 0] == round(answer.exposure / UNIT)
            assert not one.failure_reason
            strike.join()
            behind.fault = ""
            with contextlib.suppress(DeviceError):
                # A camera that hung needs a moment to let go of itself.
                one.health()
            assert one.set_exposure(3e-3).actual == pytest.approx(3e-3)
            assert one.capture(never).image[0, 0] == 30


def test_a_capture_can_be_cancelled():
    with (
        camera(machine()) as one,
        pytest.raises(DeviceError, match="it was cancelled"),
    ):
        one.capture(lambda: True)


def test_made_safe_it_is_stopped_until_the_next_command():
    behind = machine()
    with camera(behind) as one:
        one.set_exposure(2e-3)
        one.make_safe()
        one.make_safe()
        assert one.capture(never).image[0, 0] == 20
        assert behind.opened == 2


@pytest.mark.parametrize(
    ("refused", "value", "said"),
    [(cv2.CAP_PROP_AUTO_EXPOSURE, None, "automatic exposure can't be switched off"),
     (cv2.CAP_PROP_AUTO_WB, None, "automatic white balance can't be switched off"),
     (cv2.CAP_PROP_AUTOFOCUS, None, "automatic focus can't be switched off"),
     (cv2.CAP_PROP_EXPOSURE, None, "it refuses the exposure"),
     (cv2.CAP_PROP_GAIN, None, "its gain reads 0, not 3"),
     (cv2.CAP_PROP_EXPOSURE, -13.0, "its exposure reads -13, which is none")],
)  # fmt: skip
def test_what_a_camera_refuses_is_named(refused, value, said):
    behind = machine()
    behind.refuses.add(refused)
    if value is not None:
        behind.settings[refused] = value
    with pytest.raises(DeviceError, match=said):
        camera(behind, gain=3.0).__enter__()


def test_another_format_than_asked_for_is_named():
    with pytest.raises(DeviceError, match=r"it gives 6 x 4 pixels of 'Y16 ', not 8 x 4 of 'GREY'"):
        camera(machine(), width=8, pixel_format="GREY").__enter__()


@pytest.mark.parametrize("pixel_format", ["YUYV", "MJPG", "GREY", "Y10 ", "Y12 ", "Y16 ", "BA81"])
def test_numbers_of_pixels_come_through_every_format(pixel_format):
    picture = np.arange(24).reshape(4, 6)
    behind = machine(pixel_format=pixel_format)
    behind.expose = lambda exposure: picture
    with camera(behind, pixel_format=pixel_format) as one:
        assert np.array_equal(one.capture(never).image, picture)


@pytest.mark.parametrize("pixel_format", ["YUYV", "MJPG", "Y16 ", "RGGB"])
def test_frames_of_another_size_are_refused(pixel_format):
    with pytest.raises(ValueError, match=r"a frame of .* came"):
        decode_pixels(np.zeros((5, 7), np.uint8), pixel_format, (4, 6))


@pytest.mark.parametrize(("pixel_format", "number"), [("Y10 ", 1024), ("Y12 ", 4096)])
def test_numbers_above_the_full_scale_are_refused(pixel_format, number):
    words = np.full((4, 6), number, "<u2").view(np.uint8)
    with pytest.raises(ValueError, match=f"pixels reach {number}, and"):
        decode_pixels(words, pixel_format, (4, 6))


def test_a_camera_that_changes_its_gain_by_itself_is_named():
    behind = machine()
    with camera(behind) as one:
        one.capture(never)
        behind.settings[14] = 20.0  # CAP_PROP_GAIN
        for _ in range(2):
            with pytest.raises(DeviceError, match="by itself: gain from 0 to 20") as refused:
                one.capture(never)
            assert refused.value.lasting


def test_broken_frames_are_a_device_error():
    behind = machine()
    with camera(behind) as one:
        behind.expose = lambda exposure: np.zeros((3, 3))
        with pytest.raises(DeviceError, match="a frame of 18 bytes came, 6 x 4 pixels of Y16"):
            one.capture(never)


def test_with_the_real_opencv_a_missing_camera_is_named():
    for device in ("/dev/video77", 77):
        one = UVCCamera(Surroundings(RealClock()), device=device)
        with pytest.raises(DeviceError, match=r"open: there is no /dev/video77\. Check its cable"):
            one.__enter__()


def test_with_the_real_opencv_what_is_no_camera_is_named(tmp_path):
    path = tmp_path / "video0"
    path.write_bytes(b"no camera")
    with pytest.raises(DeviceError, match="in use by another program, or is no camera"):
        UVCCamera(Surroundings(RealClock()), device=str(path)).__enter__()


def test_it_lives_in_a_process_of_its_own():
    options = {"width": 6, "height": 4, "pixel_format": "Y16 "}
    here = Surroundings(RealClock())
    with HostedDevice(here, "uvc", "uvc_hosted:camera", options) as one:
        one.set_exposure(7e-4)
        assert one.capture(never).image[0, 0] == 7
        assert one.shape == (4, 6)
        with pytest.raises(DeviceError, match="out of range"):
            one.set_exposure(99.0)


@pytest.mark.parametrize(
    "options",
    [{"device": ""}, {"device": -1}, {"width": 0}, {"height": 1.5}, {"pixel_format": "RGB3"},
     {"frame_rate": -1}, {"exposure_range_ms": (2, 1)},
     {"exposure_range_ms": [1]}, {"exposure_range_ms": 5}, {"exposure_unit_us": 0},
     {"discard_frames": -1}, {"discard_frames": 2.0}, {"gain": float("nan")},
     {"electrons_per_number": 0}, {"source": "os:system"}, {"source": 5}],
)  # fmt: skip
def test_bad_options_are_named(options):
    (name,) = options
    with pytest.raises(ValueError, match=f"{name} is"):
        UVCCamera(Surroundings(RealClock()), **options)


def test_a_camera_whose_file_has_gone_is_gone(tmp_path):
    path = tmp_path / "video0"
    path.touch()
    with camera(machine(), device=str(path)) as one:
        assert one.unplugged_reason() == ""
        path.unlink()
        assert one.unplugged_reason() == f"{path} isn't there any more"
        path.touch()
        assert one.unplugged_reason() == ""
