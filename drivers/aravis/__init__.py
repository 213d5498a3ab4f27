"""GigE Vision and USB3 Vision cameras through Aravis, whose library has a process of its own.

`library` is what lives there; it needs nothing but Python's standard library and gi, so that it
also runs on the system's Python where this one has no gi.
"""

from __future__ import annotations

from drivers.aravis.camera import AravisCamera
from drivers.aravis.library_process import find_cameras

__all__ = ["AravisCamera", "find_cameras"]
