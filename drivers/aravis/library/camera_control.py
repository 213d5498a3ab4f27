"""An open camera of Aravis: found, opened, watched, and closed."""

from __future__ import annotations

import contextlib
import threading
import time
from typing import Any

_POLL_INTERVAL = 0.2
"""Seconds between looks at whether the camera still obeys us."""

_SILENCE_LIMIT = 0.8
"""Seconds without a word from the camera after which it counts as lost."""

_CONTROL_PRIVILEGE = 0x0A00
"""GigE Vision's register that says who controls the camera; 0 if nobody does."""

_HEARTBEAT = 0x0938
"""GigE Vision's register: milliseconds after which the camera forgets a silent controller."""

_HEARTBEAT_MS = 1500
"""Milliseconds after which a camera may be opened again whose controller has died."""

HELD_BY_OTHER = "somebody else has it open"
"""Why a camera can't be opened that answers, but doesn't obey."""


class CameraControl:
    """One camera, and whether it still obeys us. aravis: the library.

    camera, device: Aravis' own, once it is open. lost: why it is lost; empty while it isn't.
    """

    def __init__(self, aravis: Any) -> None:
        self.aravis = aravis
        self.camera: Any = None
        self.device: Any = None
        self.lost = ""
        self._last_reply_at = time.monotonic()

    def find(self) -> list[dict[str, str]]:
        a = self.aravis
        a.update_device_list()
        return [
            {
                "id": a.get_device_id(i) or "",
                "vendor": a.get_device_vendor(i) or "",
                "model": a.get_device_model(i) or "",
                "serial": a.get_device_serial_nbr(i) or "",
                "address": a.get_device_address(i) or "",
                "protocol": a.get_device_protocol(i) or "",
            }
            for i in range(a.get_n_devices())
        ]

    def open(self, address: str) -> None:
        """By its id, serial number, IP or USB address; the first one that is found if empty."""
        if address and address.count(".") != 3:
            for one in self.find():
                if address in (one["serial"], one["address"], one["id"]):
                    address = one["id"]
                    break
        camera = self.aravis.Camera.new(address or None)
        device = camera.get_device()
        if camera.is_gv_device():
            if not device.is_controller():
                raise RuntimeError(HELD_BY_OTHER)
            device.write_register(_HEARTBEAT, _HEARTBEAT_MS)
        self._last_reply_at = time.monotonic()
        self.camera, self.device = camera, device
        device.connect("control-lost", self._control_lost)
        threading.Thread(target=self._watch, daemon=True).start()

    def _control_lost(self, device: Any) -> None:
        self.lost = "control was lost: it went silent, or somebody else opened it"

    def _watch(self) -> None:
        while not self.lost:
            with contextlib.suppress(Exception):
                self.check_control()
            time.sleep(_POLL_INTERVAL)

    def check_control(self) -> None:
        """Whether the camera is there, and still obeys us."""
        if self.camera is None:
            return
        gige = self.camera.is_gv_device()
        answer = self.device.read_register(_CONTROL_PRIVILEGE if gige else 0)
        self._last_reply_at = time.monotonic()
        if gige and not answer & 3:
            self._control_lost(self.device)

    def lost_reason(self) -> str:
        """Why it counts as lost; empty while it doesn't."""
        if (
            not self.lost
            and self.camera
            and time.monotonic() - self._last_reply_at > _SILENCE_LIMIT
        ):
            self.lost = f"no word from it for {_SILENCE_LIMIT:g} s"
        return self.lost

    def close(self) -> None:
        """Let others have the camera."""
        if self.camera is not None:
            with contextlib.suppress(Exception):
                self.device.leave_control()
