"""Open and configure an OpenCV VideoCapture; all calls must be in one thread."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.device_holders import name_holders
from drivers.uvc.pixel_decoding import FULL_SCALES, is_decoded
from drivers.uvc.stream import StreamStopped

CaptureFactory = Callable[[str | int], Any]
"""Function that opens a device and returns an object like cv2.VideoCapture."""

_EXPOSURE_MANUAL = 1.0
"""V4L2_EXPOSURE_MANUAL of the kernel's V4L2 camera controls."""


@dataclass(frozen=True)
class CaptureMode:
    """The mode in which a camera runs; ValueError for an impossible one.

    unit: the camera's unit of exposure in seconds.
    """

    device: str | int
    width: int
    height: int
    pixel_format: str
    frame_rate: float
    unit: float
    gain: float | None

    def __post_init__(self) -> None:
        number = type(self.device) is int and self.device >= 0
        if not number and not (isinstance(self.device, str) and self.device):
            raise ValueError(f'device is {self.device!r}; give "/dev/video0", or 0')
        for name in ("width", "height"):
            value = getattr(self, name)
            if type(value) is not int or not 1 <= value <= 16384:
                raise ValueError(f"{name} is {value!r}; give it in pixels")
        if self.pixel_format not in FULL_SCALES:
            raise ValueError(
                f"pixel_format is {self.pixel_format!r}; choose {', '.join(FULL_SCALES)}"
            )
        if not 0 <= self.frame_rate <= 1000:
            raise ValueError(f"frame_rate is {self.frame_rate}; give it in Hz, or 0")
        if not 0 < self.unit <= 1:
            raise ValueError(f"exposure_unit_us is {self.unit * 1e6:g}; it is 100 by V4L2")
        if self.gain is not None and not math.isfinite(self.gain):
            raise ValueError(f"gain is {self.gain}; give a number, or leave it out")

    @property
    def shape(self) -> tuple[int, int]:
        return self.height, self.width


def device_path(device: str | int) -> Path:
    """Return the path of a Video4Linux device file."""
    return Path(f"/dev/video{device}" if isinstance(device, int) else device)


def resolve_source(source: CaptureFactory | None) -> CaptureFactory:
    """Return the function that opens a camera: OpenCV's by default.

    ValueError if it isn't a function: no text of a bench file names code.
    """
    if source is None:
        return _open_v4l2
    if not callable(source):
        raise ValueError(f"source is {source!r}; leave it out, or give a function in a script")
    return source


def _open_v4l2(device: str | int) -> Any:
    # OpenCV would wait ten seconds for a stream that has stopped. It reads this when it is loaded.
    os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "1")
    import cv2

    path = device_path(device)
    if not path.exists():
        raise StreamStopped(f"there is no {path}")
    if not os.access(path, os.R_OK | os.W_OK):
        raise StreamStopped(f"the system denies access to {path}; join the group video")
    return cv2.VideoCapture(device, cv2.CAP_V4L2)


def open_capture(mode: CaptureMode, source: CaptureFactory) -> Any:
    """Open a VideoCapture in the mode; StreamStopped if the camera refuses it."""
    capture = source(mode.device)
    try:
        if not capture.isOpened():
            who = name_holders(str(device_path(mode.device)))
            trouble = f"in use by {who}" if who else "in use by another program, or is no camera"
            raise StreamStopped(f"{mode.device} is {trouble}")
        _set_format(capture, mode)
        _disable_automatics(capture, mode)
    except BaseException:
        capture.release()
        raise
    return capture


def _set_format(capture: Any, mode: CaptureMode) -> None:
    import cv2

    capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*mode.pixel_format))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, mode.width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, mode.height)
    if mode.frame_rate:
        capture.set(cv2.CAP_PROP_FPS, mode.frame_rate)
    capture.set(cv2.CAP_PROP_CONVERT_RGB, 1.0 if is_decoded(mode.pixel_format) else 0.0)
    width = round(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
    height = round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
    letters = code.to_bytes(4, "little").decode("ascii", errors="replace")
    if (width, height, letters) != (mode.width, mode.height, mode.pixel_format):
        raise StreamStopped(
            f"it gives {width} x {height} pixels of {letters!r}, not {mode.width} x "
            f"{mode.height} of {mode.pixel_format!r}: choose what it has"
        )


def _disable_automatics(capture: Any, mode: CaptureMode) -> None:
    """Turn off automatic exposure, white balance and focus; set the gain."""
    import cv2

    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _EXPOSURE_MANUAL)
    _require_manual(capture)
    for name, number in (
        ("white balance", cv2.CAP_PROP_AUTO_WB),
        ("focus", cv2.CAP_PROP_AUTOFOCUS),
    ):
        # A control that the camera lacks can't be set and reads as 0 or -1.
        capture.set(number, 0.0)
        if capture.get(number) == 1:
            raise StreamStopped(f"its automatic {name} can't be switched off")
    if mode.gain is not None:
        capture.set(cv2.CAP_PROP_GAIN, mode.gain)
        if capture.get(cv2.CAP_PROP_GAIN) != mode.gain:
            raise StreamStopped(
                f"its gain reads {capture.get(cv2.CAP_PROP_GAIN):g}, not {mode.gain:g}"
            )


def _require_manual(capture: Any) -> None:
    import cv2

    if capture.get(cv2.CAP_PROP_AUTO_EXPOSURE) != _EXPOSURE_MANUAL:
        raise StreamStopped("its automatic exposure can't be switched off")


def read_exposure_units(capture: Any) -> float:
    """Read the exposure in the camera's own units."""
    import cv2

    units = float(capture.get(cv2.CAP_PROP_EXPOSURE))
    if not 0 < units < math.inf:
        raise StreamStopped(f"its exposure reads {units:g}, which is none")
    return units


def set_exposure_units(capture: Any, units: int) -> float:
    """Set the exposure in the camera's own units; return what it then reads."""
    import cv2

    if not capture.set(cv2.CAP_PROP_EXPOSURE, float(units)):
        raise StreamStopped(f"it refuses the exposure {units}")
    _require_manual(capture)
    return read_exposure_units(capture)


def read_settings(capture: Any) -> dict[str, float]:
    """Read what changes pictures, besides the exposure; -1 or 0 for what the camera lacks."""
    import cv2

    numbers = {
        "gain": cv2.CAP_PROP_GAIN,
        "automatic exposure": cv2.CAP_PROP_AUTO_EXPOSURE,
        "automatic white balance": cv2.CAP_PROP_AUTO_WB,
        "white balance": cv2.CAP_PROP_WB_TEMPERATURE,
        "gamma": cv2.CAP_PROP_GAMMA,
        "brightness": cv2.CAP_PROP_BRIGHTNESS,
        "contrast": cv2.CAP_PROP_CONTRAST,
        "sharpness": cv2.CAP_PROP_SHARPNESS,
        "saturation": cv2.CAP_PROP_SATURATION,
        "hue": cv2.CAP_PROP_HUE,
        "backlight compensation": cv2.CAP_PROP_BACKLIGHT,
    }
    return {name: float(capture.get(number)) for name, number in numbers.items()}


def describe_camera(capture: Any, device: str | int) -> dict[str, str]:
    """Return the device file, backend, name and serial number, as far as they are known."""
    path = device_path(device).resolve()
    told = {"device": str(path), "backend": str(capture.getBackendName())}
    if not re.fullmatch(r"video\d+", path.name):
        return told
    node = Path("/sys/class/video4linux") / path.name
    for name, file in (("name", node / "name"), ("serial number", node / "device/../serial")):
        if file.is_file():
            told[name] = file.read_text(errors="replace").strip()
    return told
