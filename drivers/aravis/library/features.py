"""Read and set GenICam features."""

from __future__ import annotations

import contextlib
from typing import Any

from .camera_control import CameraControl

_TEMPERATURES = ("DeviceTemperature", "DeviceTemperatureRaw", "TemperatureAbs")
_IDENTITY_FEATURES = ("DeviceFirmwareVersion", "DeviceVersion", "DeviceUserID", "DeviceLinkSpeed")


class CameraFeatures:
    """Read and set the features of an open camera; setters return what the camera reads back."""

    def __init__(self, owner: CameraControl) -> None:
        self._owner = owner

    def facts(self) -> dict[str, Any]:
        """Return the camera's identity, ranges, available formats and triggers."""
        c = self._owner.camera
        facts: dict[str, Any] = {
            "vendor": c.get_vendor_name(),
            "model": c.get_model_name(),
            "serial": c.get_device_serial_number() or c.get_device_id(),
            "protocol": "GigE Vision" if c.is_gv_device() else "USB3 Vision",
            "exposure_us": list(_pair(c.get_exposure_time_bounds())),
            "pixel_formats": list(c.dup_available_pixel_formats_as_strings()),
            "gain_db": _pair(c.get_gain_bounds()) if c.is_gain_available() else None,
            "binning": None,
            "trigger_sources": [],
            "chunks": False,
        }
        with contextlib.suppress(Exception):
            if c.is_binning_available():
                facts["binning"] = [
                    *_pair(c.get_x_binning_bounds()),
                    *_pair(c.get_y_binning_bounds()),
                ]
        with contextlib.suppress(Exception):
            facts["trigger_sources"] = list(c.dup_available_trigger_sources())
        with contextlib.suppress(Exception):
            facts["chunks"] = bool(c.are_chunks_available())
        return facts

    def set_exposure(self, us: float) -> float:
        self._owner.camera.set_exposure_time(us)
        return float(self._owner.camera.get_exposure_time())

    def exposure(self) -> float:
        return float(self._owner.camera.get_exposure_time())

    def set_gain(self, gain: float) -> float:
        self._owner.camera.set_gain(gain)
        return float(self._owner.camera.get_gain())

    def set_pixel_format(self, name: str) -> str:
        if name:
            self._owner.camera.set_pixel_format_from_string(name)
        return str(self._owner.camera.get_pixel_format_as_string())

    def set_binning(self, across: int, down: int) -> list[int]:
        self._owner.camera.set_binning(across, down)
        return _pair(self._owner.camera.get_binning())

    def average_binned_pixels(self) -> str:
        """Let the camera average the pixels that it bins; return the mode if it can't.

        A camera that doesn't tell the mode is believed: GenICam's SFNC 2.7, BinningHorizontalMode.
        """
        for name in ("BinningHorizontalMode", "BinningVerticalMode"):
            if not self._has(name):
                continue
            with contextlib.suppress(Exception):
                self._owner.device.set_string_feature_value(name, "Average")
            if (mode := self._read_feature(name)) != "Average":
                return mode
        return ""

    def set_region(self, x: int, y: int, width: int, height: int) -> list[int]:
        """Set the region in pixels; the whole sensor if width or height is 0."""
        c = self._owner.camera
        with contextlib.suppress(Exception):
            c.set_region(0, 0, -1, -1)
        if not (width and height):
            x = y = 0
            width = _pair(c.get_width_bounds())[1]
            height = _pair(c.get_height_bounds())[1]
        c.set_region(x, y, width, height)
        return region_list(c.get_region())

    def set_frame_rate(self, rate: float) -> float:
        self._owner.camera.set_frame_rate(rate)
        return float(self._owner.camera.get_frame_rate())

    def set_trigger(self, source: str) -> str:
        """Set the trigger source; let the camera run freely if it is empty."""
        if source:
            self._owner.camera.set_trigger(source)
            return str(self._owner.camera.get_trigger_source())
        self._owner.camera.clear_triggers()
        return ""

    def set_packet_size(self, size: int) -> int:
        """Set the packet size in bytes, or negotiate it if 0; return the size.

        The result is 0 for a camera without packets.
        """
        if not self._owner.camera.is_gv_device():
            return 0
        if size:
            self._owner.camera.gv_set_packet_size(size)
        else:
            with contextlib.suppress(Exception):
                self._owner.camera.gv_auto_packet_size()
        return int(self._owner.camera.gv_get_packet_size())

    def health(self) -> dict[str, str]:
        told = {}
        for name in (*_IDENTITY_FEATURES, *_TEMPERATURES):
            with contextlib.suppress(Exception):
                if self._has(name):
                    told[name] = self._read_feature(name)
        return told

    def _has(self, name: str) -> bool:
        device = self._owner.device
        return bool(device.get_feature(name) and device.is_feature_available(name))

    def _read_feature(self, name: str) -> str:
        node = self._owner.device.get_feature(name)
        if isinstance(node, self._owner.aravis.GcFloat):
            return f"{self._owner.device.get_float_feature_value(name):g}"
        if isinstance(node, self._owner.aravis.GcInteger):
            return str(self._owner.device.get_integer_feature_value(name))
        return str(self._owner.device.get_string_feature_value(name))


def _pair(two: Any) -> list[Any]:
    return [two[0], two[1]]


def region_list(region: Any) -> list[int]:
    return [region[0], region[1], region[2], region[3]]
