"""A UVC camera as OpenCV's VideoCapture shows it with V4L2.

It runs freely, in the wall's time. A new exposure shows some frames later; the system holds
four frames ready and loses what comes besides. Source: the documentation of V4L2's streaming
and camera controls, and OpenCV's of VideoCapture.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_QUEUE = 4
_UNIT = 1e-4
_SELECT = 1.0
"""Seconds that a read waits for a frame."""

_POS_MSEC, _WIDTH, _HEIGHT, _FPS, _FOURCC = 0, 3, 4, 5, 6
_GAIN, _EXPOSURE, _CONVERT, _AUTO_EXPOSURE, _AUTOFOCUS, _AUTO_WB = 14, 15, 16, 21, 39, 44


class _Exposed(NamedTuple):
    end: float
    exposure: float


class UvcCameraMachine:
    """A camera to be opened by `source`, the option of drivers.uvc.UVCCamera.

    expose: the numbers of a picture, (height, width), of an exposure in seconds. frame_rate: in
    Hz. slows_down: whether a longer exposure slows it down; else that is cut short, untold.
    latency: frames that are begun with the old exposure after a new one was set. stamped:
    whether frames have times. fault: "stopped stream", "disconnect", "hang" or none, to be set
    at any time. refuses: numbers of properties that can't be set.
    """

    def __init__(
        self,
        expose: Callable[[float], NDArray[np.integer[Any]]],
        width: int = 640,
        height: int = 480,
        frame_rate: float = 30.0,
        latency: int = 2,
        stamped: bool = True,
        pixel_format: str = "YUYV",
        slows_down: bool = True,
    ) -> None:
        self.expose = expose
        self.latency, self.stamped = latency, stamped
        self.fault = ""
        self.refuses: set[int] = set()
        self.opened = 0
        self._formats = (width, height, pixel_format)
        self._period = 1 / frame_rate
        self._slows_down = slows_down
        self._turn = threading.Lock()
        self.settings = {_GAIN: 0.0, _EXPOSURE: 156.0, _AUTO_EXPOSURE: 3.0, _AUTO_WB: 1.0}
        self.settings |= {_AUTOFOCUS: 1.0, _FPS: frame_rate, _CONVERT: 1.0}
        self._exposure = 156 * _UNIT
        self._plan: deque[list[float]] = deque()
        self._queue: deque[_Exposed] = deque()
        self._next_end = 0.0

    def source(self, device: str | int) -> _Capture:
        """What cv2.VideoCapture(device) would give."""
        return _Capture(self)

    def start(self) -> None:
        with self._turn:
            self.opened += 1
            self._queue.clear()
            self._next_end = time.monotonic() + self._frame_time

    @property
    def _frame_time(self) -> float:
        return max(self._period, self._exposure) if self._slows_down else self._period

    def change(self, exposure: float) -> None:
        with self._turn:
            self._run(time.monotonic())
            # One is being exposed; so many more are begun as before.
            self._plan.append([1 + self.latency, exposure])

    def _run(self, now: float) -> None:
        """Expose all frames that have ended by now; the queue keeps the oldest."""
        while self._next_end <= now:
            if len(self._queue) < _QUEUE:
                exposure = min(self._exposure, self._frame_time)
                self._queue.append(_Exposed(self._next_end, exposure))
            for change in self._plan:
                change[0] -= 1
            while self._plan and self._plan[0][0] <= 0:
                self._exposure = self._plan.popleft()[1]
            self._next_end += self._frame_time

    def take(self) -> _Exposed | None:
        """The oldest frame of the queue, once there is one."""
        late = time.monotonic() + _SELECT
        while True:
            if self.fault == "disconnect":
                return None
            if self.fault == "hang":
                late = time.monotonic() + _SELECT
            with self._turn:
                now = time.monotonic()
                if self.fault:
                    self._next_end = now + self._frame_time
                self._run(now)
                if self._queue:
                    return self._queue.popleft()
                wait = self._next_end - now
            if now >= late:
                return None
            time.sleep(min(max(wait, 0.0), 0.02))

    def picture(self, exposed: _Exposed) -> NDArray[Any]:
        """Its bytes, or a picture of three colours, as VideoCapture gives them."""
        numbers = np.asarray(self.expose(exposed.exposure))
        letters = self._formats[2]
        if letters == "MJPG":
            return np.repeat(numbers.astype(np.uint8)[..., None], 3, axis=2)
        if letters == "YUYV":
            return np.stack([numbers.astype(np.uint8), np.full(numbers.shape, 128, np.uint8)], -1)
        kind = "<u2" if letters in ("Y10 ", "Y12 ", "Y16 ") else "u1"
        return np.ascontiguousarray(numbers.astype(kind)).view(np.uint8).reshape(1, -1)

    def read_back(self, number: int) -> float:
        width, height, letters = self._formats
        code = int.from_bytes(letters.encode("ascii"), "little")
        fixed = {_WIDTH: width, _HEIGHT: height, _FOURCC: code}
        return float(fixed.get(number, self.settings.get(number, 0.0)))


class _Capture:
    """Behaves as cv2.VideoCapture does."""

    def __init__(self, camera: UvcCameraMachine) -> None:
        self._camera = camera
        self._open = camera.fault != "disconnect"
        self._grabbed: _Exposed | None = None
        if self._open:
            camera.start()

    def isOpened(self) -> bool:
        return self._open

    def getBackendName(self) -> str:
        return "V4L2"

    def set(self, number: int, value: float) -> bool:
        if number in self._camera.refuses or number == _POS_MSEC:
            return False
        self._camera.settings[number] = value
        if number == _EXPOSURE:
            self._camera.change(value * _UNIT)
        return True

    def get(self, number: int) -> float:
        if number == _POS_MSEC:
            stamped = self._camera.stamped and self._grabbed is not None
            return self._grabbed.end * 1e3 if stamped and self._grabbed else 0.0
        return self._camera.read_back(number)

    def grab(self) -> bool:
        self._grabbed = self._camera.take()
        return self._grabbed is not None

    def retrieve(self) -> tuple[bool, Any]:
        if self._grabbed is None:
            return False, None
        return True, self._camera.picture(self._grabbed)

    def release(self) -> None:
        self._open = False
