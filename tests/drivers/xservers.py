"""X servers of our own, and readers of their screens that aren't ours: xwd and xrandr."""

from __future__ import annotations

import contextlib
import os
import shutil
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

PATIENCE = 60
"""Seconds after which what should have come long ago is given up."""

XORG = "xserver-xorg-core xserver-xorg-video-dummy x11-xserver-utils x11-apps openbox"

_TWO_SCREENS = """
Section "Device"
  Identifier "card"
  Driver "dummy"
  VideoRam 65536
EndSection
Section "Monitor"
  Identifier "monitor"
  HorizSync 5-1000
  VertRefresh 5-200
EndSection
Section "Screen"
  Identifier "screen"
  Device "card"
  Monitor "monitor"
  DefaultDepth 24
  SubSection "Display"
    Depth 24
    Virtual 3200 1080
  EndSubSection
EndSection
"""


def wait_for(seen: Callable[[], object], what: str) -> None:
    late = time.monotonic() + PATIENCE
    while not seen():
        assert time.monotonic() < late, f"never: {what}"
        time.sleep(0.02)


class XServer:
    """A display, asked by the tools that come with X."""

    def __init__(self, display: str, process: int) -> None:
        self.display, self.process = display, process

    def run(self, *command: str, given: str = "") -> str:
        done = subprocess.run(
            command,
            input=given,
            env={**os.environ, "DISPLAY": self.display},
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=True,
        )
        return done.stdout

    def xrandr(self, words: str) -> str:
        return self.run("xrandr", *words.split())

    def pixels(self) -> NDArray[np.uint8]:
        """The whole screen by xwd: (rows, columns, 3), blue, green, red."""
        command = ["xwd", "-display", self.display, "-root", "-silent"]
        told = b""
        while not told:  # it fails when a window goes while it looks
            done = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False)
            told = done.stdout
        header = struct.unpack(">25I", told[:100])
        rows, bits, line, begin = header[5], header[11], header[12], header[0] + 12 * header[19]
        # With windows of several visuals it packs pixels into 3 bytes, and lines all the same.
        size = header[4] * bits // 8
        line = line if len(told) - begin >= rows * line else size
        data = np.frombuffer(told, np.uint8, rows * line, begin).reshape(rows, line)
        return data[:, :size].reshape(rows, header[4], bits // 8)[..., :3]

    @contextlib.contextmanager
    def program(self, *command: str) -> Iterator[subprocess.Popen[bytes]]:
        """A program on this display while the block lasts."""
        process = subprocess.Popen(
            command, env={**os.environ, "DISPLAY": self.display}, stderr=subprocess.DEVNULL
        )
        try:
            yield process
        finally:
            process.terminate()
            process.wait()


@contextlib.contextmanager
def started(command: list[str]) -> Iterator[XServer]:
    """A server of a free number, which the command's -displayfd asks for."""
    reading, writing = os.pipe()
    server = subprocess.Popen(
        [*command, "-displayfd", str(writing), "-nolisten", "tcp", "-noreset"],
        pass_fds=[writing],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    os.close(writing)
    try:
        with os.fdopen(reading) as told:
            number = told.readline().strip()
        assert number, f"{command[0]} didn't start"
        yield XServer(f":{number}", server.pid)
    finally:
        server.kill()
        server.wait()


@contextlib.contextmanager
def xvfb(size: str) -> Iterator[XServer]:
    program = shutil.which("Xvfb")
    if program is None:
        pytest.fail("Install Xvfb: sudo apt-get install xvfb x11-apps x11-xserver-utils")
    with started([program, "-screen", "0", f"{size}x24"]) as server:
        yield server


@contextlib.contextmanager
def xorg(folder: Path) -> Iterator[XServer]:
    """DUMMY0, 1280x1024, is the operator's; DUMMY1, 1920x1080 at 60 Hz, lies at its right."""
    if os.geteuid():
        pytest.skip("Xorg without a screen of its own wants root")
    program = shutil.which("Xorg")
    if program is None:
        pytest.fail(f"Install Xorg: sudo apt-get install {XORG}")
    file = folder / "xorg.conf"
    file.write_text(_TWO_SCREENS)
    log = str(folder / "xorg.log")
    options = ["-novtswitch", "-sharevts", "-config", str(file), "-logfile", log]
    with started([program, *options]) as server:
        server.xrandr("--addmode DUMMY1 1920x1080")
        lay_out(server)
        yield server


def lay_out(server: XServer) -> None:
    """As they are on a bench, whatever a test did to them."""
    server.xrandr(
        "--output DUMMY0 --mode 1280x1024 --rate 60.02 --pos 0x0 --primary --rotate normal "
        "--output DUMMY1 --mode 1920x1080 --pos 1280x0 --rotate normal --gamma 1:1:1"
    )
    # Asked, it looks what is plugged in: the dummy driver's screens are, once they are lit.
    server.xrandr("")


def edid(name: bytes, serial: bytes) -> bytes:
    """By VESA's E-EDID standard, release A2: maker HEC, two text descriptors."""
    told = bytearray(128)
    told[:8] = bytes.fromhex("00ffffffffffff00")
    told[8:10] = (8 << 10 | 5 << 5 | 3).to_bytes(2, "big")
    for at, kind, text in ((72, 0xFC, name), (90, 0xFF, serial)):
        told[at : at + 5] = bytes([0, 0, 0, kind, 0])
        told[at + 5 : at + 18] = (text + b"\n").ljust(13)[:13]
    told[127] = -sum(told) % 256
    return bytes(told)
