"""Drive GigE Vision and USB3 Vision cameras through the Aravis library, in a child process.

The code in `library` runs in that child process. It needs only Python's standard library and gi,
so that it also runs on the system's Python where the application's Python has no gi.
"""

from __future__ import annotations

from drivers.aravis.camera import AravisCamera
from drivers.aravis.library_process import find_cameras

__all__ = ["AravisCamera", "find_cameras"]
