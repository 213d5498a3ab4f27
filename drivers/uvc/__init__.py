"""Drive UVC cameras (webcams) through OpenCV and Video4Linux2."""

from __future__ import annotations

from drivers.uvc.camera import UVCCamera

__all__ = ["UVCCamera"]
