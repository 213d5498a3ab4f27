"""Drive an SLM that is connected as a second display, by a window in a child process on X11.

`ScreenSLM` is the driver; `identify` labels the screens. Importing this package loads no Qt: only
the window's process does.
"""

from __future__ import annotations

from drivers.screen.driver import ScreenSLM
from drivers.screen.identify import identify_screens, list_screens
from drivers.screen.player import Presentations

__all__ = ["Presentations", "ScreenSLM", "identify_screens", "list_screens"]
