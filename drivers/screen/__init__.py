"""A phase panel that is a second display: a window in a process of its own, on X11.

`ScreenSLM` is the driver; `identify` shows which screen is which. Importing this loads no Qt:
only the window's process does.
"""

from __future__ import annotations

from drivers.screen.driver import ScreenSLM
from drivers.screen.identify import identify_screens, list_screens
from drivers.screen.player import Presentations

__all__ = ["Presentations", "ScreenSLM", "identify_screens", "list_screens"]
