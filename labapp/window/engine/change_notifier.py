"""Telling how something stands when it has changed, as often as somebody can read."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

_INTERVAL = 0.1
"""Seconds between reports: more often than anybody reads only costs time."""


class ChangeNotifier:
    """Calls `report` after notify(), from a thread of its own; the last change is never lost."""

    def __init__(self, report: Callable[[], None]) -> None:
        self._tell = report
        self._news = threading.Event()
        threading.Thread(target=self._watch, name="change-notifier", daemon=True).start()

    def notify(self) -> None:
        self._news.set()

    def _watch(self) -> None:
        while self._news.wait():
            self._news.clear()
            self._tell()
            time.sleep(_INTERVAL)
