"""Find, open, monitor and close a camera."""

from __future__ import annotations

import contextlib
import threading
import time
from dataclasses import dataclass
from enum import IntEnum
from typing import Any


class _GigeRegister(IntEnum):
    """Addresses of GigE Vision's bootstrap registers."""

    HEARTBEAT = 0x0938
    """Milliseconds after which the camera forgets a silent controller."""

    CONTROL_PRIVILEGE = 0x0A00
    """Which application controls the camera; 0 if none does."""

    CONTROLLER_PORT = 0x0A04
    """UDP port of the application that controls the camera, where the camera tells it."""

    CONTROLLER_ADDRESS = 0x0A14
    """IP address of the application that controls the camera, where the camera tells it."""


@dataclass(frozen=True)
class ControlTiming:
    """Tune how quickly a lost camera is noticed.

    poll_interval: seconds between checks of whether this process still controls the camera. Chosen.
    silence_limit: seconds that a question stays unanswered after which the camera is lost. Chosen.
    heartbeat_ms: milliseconds after the death of its controller until a camera may be opened again.
    Chosen.
    """

    poll_interval: float = 0.2
    silence_limit: float = 0.8
    heartbeat_ms: int = 1500


_TIMING = ControlTiming()

HELD_BY_OTHER = "somebody else has it open"
"""Reply for a camera that answers, but is controlled by another program."""


def _controller_place(device: Any) -> str:
    """Return where the program is that controls a camera; empty if it isn't told."""
    with contextlib.suppress(Exception):
        address = device.read_register(_GigeRegister.CONTROLLER_ADDRESS) & 0xFFFFFFFF
        port = device.read_register(_GigeRegister.CONTROLLER_PORT) & 0xFFFF
        if address and port:
            return f", at {'.'.join(map(str, address.to_bytes(4, 'big')))}:{port}"
    return ""


class CameraControl:
    """Open one camera, and monitor whether this process still controls it.

    aravis: the library. camera, device: its objects of the open camera. lost: why the camera is
    lost; empty while it isn't.
    """

    def __init__(self, aravis: Any) -> None:
        self.aravis = aravis
        self.camera: Any = None
        self.device: Any = None
        self.lost = ""
        self._silent_since: float | None = None

    def find(self) -> list[dict[str, str]]:
        """List the GenICam cameras that are found, with their addresses."""
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
        """Open a camera by id, serial number, IP or USB address; the first if empty."""
        if address and address.count(".") != 3:
            for one in self.find():
                if address in (one["serial"], one["address"], one["id"]):
                    address = one["id"]
                    break
        camera = self.aravis.Camera.new(address or None)
        device = camera.get_device()
        if camera.is_gv_device():
            if not device.is_controller():
                raise RuntimeError(HELD_BY_OTHER + _controller_place(device))
            device.write_register(_GigeRegister.HEARTBEAT, _TIMING.heartbeat_ms)
        with contextlib.suppress(Exception):
            # A controller that was killed has left it running.
            camera.stop_acquisition()
        self._silent_since = None
        self.camera, self.device = camera, device
        device.connect("control-lost", self._control_lost)
        threading.Thread(target=self._watch, daemon=True).start()

    def _control_lost(self, device: Any) -> None:
        self.lost = "control was lost: it went silent, or somebody else opened it"

    def _watch(self) -> None:
        while not self.lost:
            with contextlib.suppress(Exception):
                self.check_control()
            time.sleep(_TIMING.poll_interval)

    def check_control(self) -> None:
        """Check that this process still controls the camera; otherwise note it as lost."""
        if self.camera is None:
            return
        gige = self.camera.is_gv_device()
        # Silence begins with a question: a busy computer that asks late has not lost its camera.
        self._silent_since = self._silent_since or time.monotonic()
        answer = self.device.read_register(_GigeRegister.CONTROL_PRIVILEGE if gige else 0)
        self._silent_since = None
        if gige and not answer & 3:
            self._control_lost(self.device)

    def lost_reason(self) -> str:
        """Return why the camera counts as lost; empty while it doesn't."""
        limit, since = _TIMING.silence_limit, self._silent_since
        if not self.lost and self.camera and since and time.monotonic() - since > limit:
            self.lost = f"no word from it for {limit:g} s"
        return self.lost

    def close(self) -> None:
        """Give up control of the camera, so that other programs can open it."""
        if self.camera is not None:
            with contextlib.suppress(Exception):
                self.device.leave_control()
