"""Notification of changes at a limited rate."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

REPORT_INTERVAL = 0.1
"""Seconds between reports to the window. More reports cost time, and nobody reads them faster."""


class ChangeNotifier:
    """Call `report` after notify(), in a thread, at a limited rate, and after the last change."""

    def __init__(self, report: Callable[[], None]) -> None:
        self._tell = report
        self._news = threading.Event()
        threading.Thread(target=self._watch, name="change-notifier", daemon=True).start()

    def notify(self) -> None:
        """Request that a change be reported."""
        self._news.set()

    def _watch(self) -> None:
        while self._news.wait():
            self._news.clear()
            self._tell()
            time.sleep(REPORT_INTERVAL)
