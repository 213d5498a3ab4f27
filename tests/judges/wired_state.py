"""In what state a bench is, asked at its wires: screen, serial port and network, by no driver."""

from __future__ import annotations

import os
import select
import socket
import struct
import subprocess
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

_PATIENCE = 3.0
"""Seconds within which an instrument answers. Chosen: it takes milliseconds."""

_GVCP_PORT, _READ_REGISTER, _ACKNOWLEDGE = 3956, 0x0080, 0x01
"""Port, command and flag of GigE Vision's control protocol."""

_PRIVILEGE, _STREAM_PORT = 0x0A00, 0x0D00
"""GigE Vision's registers of who controls the camera, and where its stream goes."""

_FAKE_RUNNING = 0x0124
"""Register of Aravis' fake camera that AcquisitionStart and AcquisitionStop write."""


def unsafe_devices(devices: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """What isn't safe of a bench's devices, in words. devices: their options, by role."""
    told = []
    levels = screen_levels(str(devices["slm"]["display"]))
    if len(levels) > 1:
        told.append(f"the panel shows {len(levels)} levels")
    stands, parked = filter_wavelengths(str(devices["filter"]["port"]))
    if stands != parked:
        told.append(f"the filter stands at {stands} nm, not {parked} nm")
    address = str(devices["camera"]["address"])
    if camera_register(address, _FAKE_RUNNING):
        told.append("the camera takes frames")
    if camera_register(address, _PRIVILEGE):
        told.append("the camera has a controller")
    return told


def screen_levels(display: str) -> set[int]:
    """The levels of all bytes that a display's root window shows, by the tool xwd."""
    data = subprocess.run(
        ["xwd", "-display", display, "-root", "-silent"], capture_output=True, check=True
    ).stdout
    header = struct.unpack(">25I", data[:100])
    size, width, height, line, colours = header[0], header[4], header[5], header[12], header[19]
    start = size + 12 * colours
    rows = np.frombuffer(data, np.uint8, line * height, start).reshape(height, line)
    return set(np.unique(rows.reshape(height, -1, 4)[:, :width, :3]).tolist())


def filter_wavelengths(port: str) -> tuple[float, float]:
    """Where a VariSpec stands, and the end of its range at which it's parked, in nm."""
    handle = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        _ask_varispec(handle, b"")
        stands = _ask_varispec(handle, b"W ?").split()[-1]
        shortest = _ask_varispec(handle, b"V ?").split()[-3]
    finally:
        os.close(handle)
    return float(stands), float(shortest)


def _ask_varispec(handle: int, command: bytes) -> str:
    """A VariSpec's answer to a command, after the echo; manual 1.37, chapter 4."""
    os.write(handle, command + b"\r")
    heard, late = b"", time.monotonic() + _PATIENCE
    while time.monotonic() < late and (not command or heard.count(b"\r") < 2):
        if select.select([handle], [], [], 0.2)[0]:
            with suppress(BlockingIOError):
                heard += os.read(handle, 256)
        elif not command:
            break
    return heard.decode("ascii", "replace").replace("\r", "\n").strip()


def camera_register(address: str, register: int) -> int:
    """A register of a GigE Vision camera, by READREG_CMD, which needs no privilege."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.settimeout(_PATIENCE)
        request = struct.pack(">BBHHHI", 0x42, _ACKNOWLEDGE, _READ_REGISTER, 4, 1, register)
        line.sendto(request, (address, _GVCP_PORT))
        answer = line.recv(64)
    status, value = struct.unpack(">H6xI", answer[:12])
    if status:
        raise OSError(f"the camera refuses to tell register {register:#x}: status {status:#x}")
    return int(value)
