"""Connect to an X server: list its screens, and read the pixels that a screen shows.

The package speaks X11's core protocol and some extensions through libxcb, which Qt's X11 plugin
needs, too. It loads no Qt, and every wait has a timeout. Requests are laid out as in the X.Org
documents "X Window System Protocol", "RandR", "Present" and "DAMAGE".
"""

from __future__ import annotations

from drivers.x11.connection import XConnection, XError, XServerGone
from drivers.x11.reader import ScreenReader

__all__ = ["ScreenReader", "XConnection", "XError", "XServerGone"]
