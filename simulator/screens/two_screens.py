"""An X server with a bench's two screens, the operator's and the panel: Xorg's dummy driver."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from simulator.screens.server import NoXServer, XServer, require_program, running_server

PANEL = np.s_[:1080, 1280:3200]
"""Rows and columns of the panel's screen among the pixels of both screens."""

NEIGHBOUR = np.s_[:, :1280]
"""Rows and columns of the operator's screen, at the left of the panel's."""

_PACKAGES = "xserver-xorg-core xserver-xorg-video-dummy x11-xserver-utils x11-apps"

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


@contextmanager
def xorg(folder: Path) -> Iterator[XServer]:
    """Run an X server with two screens and no monitors while the block lasts.

    DUMMY0, 1280x1024, is the operator's screen; DUMMY1, 1920x1080 at 60 Hz, is the panel's, at its
    right.

    Parameters
    ----------
    folder : Path
        Folder for the server's configuration and log.

    Yields
    ------
    XServer
        The running server.

    Raises
    ------
    NoXServer
        If Xorg or one of its tools isn't installed, it doesn't start, or the user isn't root.
    """
    program = require_program("Xorg", _PACKAGES)
    for tool in ("xrandr", "xwd"):
        require_program(tool, _PACKAGES)
    if os.geteuid():
        raise NoXServer("Xorg without a screen of its own wants root")
    file = folder / "xorg.conf"
    file.write_text(_TWO_SCREENS)
    log = str(folder / "xorg.log")
    options = ["-novtswitch", "-sharevts", "-config", str(file), "-logfile", log]
    with running_server([program, *options]) as server:
        server.xrandr("--addmode DUMMY1 1920x1080")
        lay_out(server)
        yield server


def lay_out(server: XServer) -> None:
    """Lay the two screens out as on a bench, whatever their layout was before.

    Parameters
    ----------
    server : XServer
        A server with the two screens of `xorg`.
    """
    server.xrandr(
        "--output DUMMY0 --mode 1280x1024 --rate 60.02 --pos 0x0 --primary --rotate normal "
        "--output DUMMY1 --mode 1920x1080 --pos 1280x0 --rotate normal --gamma 1:1:1"
    )
    # A query lets the server detect its outputs again: the dummy driver's count as connected once
    # they have a mode.
    server.xrandr("")
