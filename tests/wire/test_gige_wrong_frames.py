"""What a camera on the wire does to its frames is undone, named, or told by its options."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from coded_pictures import camera, never
from judges import wire_frames as made

from drivers.aravis import AravisCamera
from drivers.errors import DeviceError
from simulator.wire.fake_gige import FakeGigECamera

pytestmark = pytest.mark.aravis

SHAPE = (32, 48)


class Sensor:
    """A sensor in even light. last: its last picture."""

    def __init__(self, bits: int = 12) -> None:
        self._sensor = made.Sensor(bits, 2e4, 5.0, 20.0)
        self._rng = np.random.default_rng(0)
        self.last = np.zeros(SHAPE, np.uint16)

    def __call__(self, exposure: float, gain_db: float) -> made.Picture:
        light = np.full(SHAPE, 0.3 * 10 ** (gain_db / 20))
        self.last = self._sensor.numbers(self._rng, light)
        return self.last


def fake(sensor: Sensor, **options: Any) -> FakeGigECamera:
    return FakeGigECamera(sensor, SHAPE, "Mono12", **options)


def opened(**options: Any) -> AravisCamera:
    return camera(**{"latency_frames": 0, "pixel_format": "Mono12", **options})


@pytest.mark.parametrize(
    ("how", "given"),
    [
        ({"pack": lambda p, form: made.words(p, big=True)}, {"byte_order": "big"}),
        ({"pack": lambda p, form: made.words(p, left=4)}, {"justification": "left"}),
        (
            {
                "pack": lambda p, form: made.padded(p, "Mono12", 12),
                "leader": {"padding": 12},
                "more_bytes": 12 * 32,
            },
            {},
        ),
    ],
)
def test_frames_are_read_as_they_are_told_to_come(
    how: dict[str, Any], given: dict[str, Any]
) -> None:
    sensor = Sensor()
    with fake(sensor, **how), opened(**given) as device:
        device.set_exposure(1e-3)
        for _ in range(2):
            np.testing.assert_array_equal(device.capture(never).image, sensor.last)


def test_what_changes_pictures_is_turned_off_and_told() -> None:
    sensor = Sensor()
    features = {"ReverseX": 1, "TestPattern": 1, "Gamma": 0.5, "GammaEnable": 1}
    with fake(sensor, features=features), opened() as device:
        device.set_exposure(1e-3)
        np.testing.assert_array_equal(device.capture(never).image, sensor.last)
        told = device.health()["turned off"]
        assert "ReverseX = on" in told
        assert "TestPattern = GreyDiagonalRamp" in told


def test_what_lies_behind_another_entry_of_a_selector_is_turned_off_and_watched() -> None:
    sensor, hidden = Sensor(), "TestPattern[ImageProcessor]"
    with fake(sensor, features={hidden: 1}) as behind, opened() as device:
        device.set_exposure(1e-3)
        np.testing.assert_array_equal(device.capture(never).image, sensor.last)
        assert f"{hidden} = GreyDiagonalRamp" in device.health()["turned off"]
        behind.set_features(**{hidden: 1})
        with pytest.raises(DeviceError, match=r"test pattern|ImageProcessor. from Off"):
            device.capture(never)


def test_what_the_bench_file_keeps_stays_on() -> None:
    sensor = Sensor()
    with fake(sensor, features={"ReverseX": 1}), opened(keep_features=["ReverseX"]) as device:
        device.set_exposure(1e-3)
        np.testing.assert_array_equal(device.capture(never).image, sensor.last[:, ::-1])


def test_a_feature_to_keep_that_is_not_there_is_named() -> None:
    with fake(Sensor()), pytest.raises(DeviceError, match="the camera has no feature Reversed"):
        opened(keep_features=["Reversed"]).__enter__()


def change(**values: float) -> Callable[[FakeGigECamera], None]:
    return lambda behind: behind.set_features(**values)


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (change(Gain=20), "Gain from 0 to 20"),
        (change(OffsetX=4), r"begins at pixel \[4, 0\], not \[0, 0\]"),
        (change(LUTEnable=1), "LUTEnable from off to on"),
        (change(TestPattern=1), "this is a test pattern"),
    ],
)
def test_a_camera_that_changes_by_itself_is_named_and_stays_refused(
    act: Callable[[FakeGigECamera], None], words: str
) -> None:
    with fake(Sensor()) as behind, opened() as device:
        device.set_exposure(1e-3)
        device.capture(never)
        act(behind)
        for _ in range(2):
            with pytest.raises(DeviceError, match=words) as refused:
                device.capture(never)
            assert refused.value.lasting


def test_the_gain_that_is_set_is_no_change_by_itself() -> None:
    sensor = Sensor()
    with fake(sensor), opened() as device:
        device.set_exposure(1e-3)
        device.set_gain(6.0)
        np.testing.assert_array_equal(device.capture(never).image, sensor.last)
