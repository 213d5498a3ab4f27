"""Pictures that tell by themselves how long they were exposed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.aravis import AravisCamera
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from simulator.wire.fake_gige import FakeGigECamera

SHAPE = (96, 128)
"""Pixels of a frame of some 30 packets.

When each packet is lost with a probability of one half, a frame of 10 packets is still complete
once in 1000 times."""


def never() -> bool:
    return False


def picture(exposure: float, gain_db: float = 0.0, top: int = 255) -> NDArray[np.uint16]:
    """Four digits of microseconds, one of the gain, and noise that follows from them."""
    us = round(exposure * 1e6)
    rng = np.random.default_rng([us, round(gain_db * 10)])
    image = rng.integers(0, top + 1, SHAPE, dtype=np.uint16)
    image.flat[:4] = [us >> shift & 255 for shift in (0, 8, 16, 24)]
    return image


def noisy_picture(exposure: float, gain_db: float) -> NDArray[np.uint16]:
    """The same with other lowest bits each time, but in the digits: no camera sends it twice."""
    image = picture(exposure, gain_db)
    image.flat[4:] ^= np.random.default_rng().integers(0, 2, image.size - 4, dtype=np.uint16)
    return image


def assert_shows(image: NDArray[np.uint16], expected: NDArray[np.uint16]) -> None:
    np.testing.assert_array_equal(image | 1, expected | 1)


def exposure_of(image: NDArray[np.uint16]) -> float:
    digits = [int(value) for value in image.flat[:4]]
    return sum(digit << shift for digit, shift in zip(digits, (0, 8, 16, 24), strict=True)) * 1e-6


def fake_camera(pixel_format: str = "Mono8", **options: Any) -> FakeGigECamera:
    return FakeGigECamera(noisy_picture, SHAPE, pixel_format, **options)


def camera(**options: Any) -> AravisCamera:
    return AravisCamera(Surroundings(RealClock()), **{"address": "127.0.0.1", **options})


def outcome(work: Callable[[], Any]) -> Any:
    """What a call gives, or the DeviceError that it raises."""
    try:
        return work()
    except DeviceError as error:
        return error


class AtThirdLook:
    """Turns true when it is asked for the third time. looks: how often it was."""

    def __init__(self, do: Callable[[], object] = lambda: None) -> None:
        self._do, self.looks = do, 0

    def __call__(self) -> bool:
        self.looks += 1
        if self.looks == 3:
            self._do()
        return self.looks >= 3
