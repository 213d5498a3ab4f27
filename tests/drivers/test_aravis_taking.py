"""Frames of cameras that tell each frame's own exposure, which no simulated one does."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.aravis.acquisition import FrameAcquisition
from drivers.aravis.arrivals import follows as follows_on
from drivers.aravis.camera_options import AravisOptions
from drivers.aravis.pixel_formats import FORMATS
from drivers.errors import DeviceError

SHAPE = (2, 3)


class TellingLibrary:
    """In the place of Aravis' process: it answers with notes as that one writes them.

    lag: frames for which a frame's told exposure is an old one.
    """

    model = "telling camera"

    def __init__(self, lag: int, first: int = 65534) -> None:
        self.told = [1000.0] * lag
        self.set = 1000.0
        self.number = first
        self.triggered = False

    def ask(self, name: str, *given: Any, timeout: float) -> Any:
        match name:
            case "start":
                return {"size": 6, "slot": 4096, "length": 4096}
            case "drain":
                return []
            case "exposure":
                return self.set
            case "set_exposure":
                self.set = given[0]
                return self.set
            case "trigger":
                self.triggered = True
                return time.monotonic()
            case "pop" if self.triggered:
                self.triggered = False
                return self.note()
        return None

    def note(self) -> dict[str, Any]:
        self.told.append(self.set)
        note = {
            "status": "success",
            "place": 0,
            "number": self.number,
            "arrived": time.monotonic(),
            "stamp": 0,
            "size": 6,
            "code": FORMATS["Mono8"].code,
            "region": [0, 0, 3, 2],
            "exposure_us": self.told.pop(0),
        }
        self.number = self.number + 1 if self.number < 65535 else 1
        return note

    def shared_bytes(self, place: int, size: int, length: int) -> NDArray[np.uint8]:
        return np.arange(size, dtype=np.uint8)


def taking(library: TellingLibrary) -> FrameAcquisition:
    options = AravisOptions(
        "", "", 0.0, (), (1, 1), "software", "Line0", 0.0, 0, 8, 0, 300.0, 5.0, 1.0
    )
    form = FORMATS["Mono8"]
    return FrameAcquisition(
        library,  # type: ignore[arg-type]
        options,
        form,
        [0, 0, 3, 2],
        1e-3,
        True,
        6.0,
        lambda seconds: None,
    )


@pytest.mark.parametrize("lag", [0, 1, 3])
def test_a_frame_that_tells_another_exposure_is_not_taken(lag: int) -> None:
    library = TellingLibrary(lag)
    taker = taking(library)
    taker.take(lambda: False)
    library.set, taker.exposure = 4000.0, 4e-3
    taker.mark_settings_changed()
    taken = taker.take(lambda: False)
    assert taker.counts["wrong exposure"] == lag
    assert taker.counts["thrown away"] == 0
    np.testing.assert_array_equal(taken.image, np.arange(6).reshape(SHAPE))


def test_a_camera_that_never_tells_the_right_one_is_refused() -> None:
    library = TellingLibrary(50)
    taker = taking(library)
    library.set, taker.exposure = 4000.0, 4e-3
    with pytest.raises(DeviceError, match=r"wrong exposure frame: number .* was exposed 1000"):
        taker.take(lambda: False)


@pytest.mark.parametrize(
    ("number", "last", "follows"),
    [(2, 1, True), (1, 65535, True), (0, 65535, True), (65536, 65535, True), (3, 1, False)],
)
def test_numbers_follow_one_another_in_16_and_64_bits(
    number: int, last: int, follows: bool
) -> None:
    assert follows_on(number, last) is follows
