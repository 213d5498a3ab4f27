"""A small client of an X server: what is plugged in, and what stands on the screen.

It speaks the core protocol and the extensions that it needs through libxcb, which Qt's own
X11 plugin needs, too; it loads no Qt and waits for no answer for ever. Requests are laid out
as in the X.Org documents "X Window System Protocol", "RandR", "Present" and "DAMAGE".
"""

from __future__ import annotations

from drivers.x11.connection import XConnection, XError, XServerGone
from drivers.x11.reader import ScreenReader

__all__ = ["ScreenReader", "XConnection", "XError", "XServerGone"]
