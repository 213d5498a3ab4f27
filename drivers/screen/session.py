"""Check that the desktop session is X11, and turn off Qt's scaling."""

from __future__ import annotations

import os
from collections.abc import MutableMapping

from drivers.errors import DeviceError
from drivers.x11 import XConnection, XError

_SCALING = ("QT_SCALE_FACTOR", "QT_SCREEN_SCALE_FACTORS", "QT_FONT_DPI", "QT_USE_PHYSICAL_DPI")
"""Variables that are removed: QT_SCALE_FACTOR scales even if QT_ENABLE_HIGHDPI_SCALING is 0."""

_TO_X11 = (
    "Log in to an X11 (Xorg) session, which the login screen offers; if it doesn't, write "
    "WaylandEnable=false into /etc/gdm3/daemon.conf"
)


class ServerGone(DeviceError):
    """Raised if the X server has ended, and with it all windows."""


def connect_display(model: str, display: str | None) -> XConnection:
    """Connect to the X server; DeviceError without one, or for Xwayland.

    Wayland's compositor controls screens and scaling, so that Xwayland can't show exact pixels.

    display: as in DISPLAY; None means the environment's.
    """
    if display is None and _is_wayland():
        reply = "this is a Wayland session, where no program can choose its screen or pixels"
        raise DeviceError(model, "open", reply, _TO_X11)
    name = display or os.environ.get("DISPLAY", "")
    if not name:
        reply = "there is no X display (DISPLAY isn't set)"
        remedy = (
            "Start it in an X11 session; or say which display, such as ':0': option display in "
            "the bench file, --display of labapp devices screens"
        )
        raise DeviceError(model, "open", reply, remedy)
    try:
        x = XConnection(name)
        if x.has("XWAYLAND"):
            x.close()
            reply = f"{name} is Xwayland, whose pixels a Wayland session scales as it likes"
            raise DeviceError(model, "open", reply, _TO_X11)
    except XError as error:
        remedy = "Look whether the display is there and you may use it (DISPLAY, XAUTHORITY)"
        raise DeviceError(model, "open", str(error), remedy) from error
    return x


def disable_scaling(environment: MutableMapping[str, str], display: str) -> None:
    """Change this process's environment so that Qt draws pixel for pixel."""
    for name in _SCALING:
        environment.pop(name, None)
    environment.update(
        QT_ENABLE_HIGHDPI_SCALING="0",
        QT_QPA_PLATFORM="xcb",
        DISPLAY=display,
    )


def _is_wayland() -> bool:
    kind = os.environ.get("XDG_SESSION_TYPE", "").lower()
    platform = os.environ.get("QT_QPA_PLATFORM", "").lower()
    return (
        kind == "wayland"
        or platform.startswith("wayland")
        or (bool(os.environ.get("WAYLAND_DISPLAY")) and kind != "x11")
    )
