"""Play a video, one frame per refresh, paced by the X server or the clock."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from PySide6.QtCore import QObject, QSocketNotifier, Qt, QTimer

from drivers.screen.player import VideoPlayer
from drivers.screen.refreshes import Refresh, RefreshEvents
from drivers.x11 import XError


class VideoPlayback(QObject):
    """Play a video until it is stopped, while Qt's event loop runs."""

    def __init__(
        self,
        frames: int,
        period: float,
        draw: Callable[[int], None],
        display: str,
        window: int,
    ) -> None:
        super().__init__()
        self.player = VideoPlayer(frames, period, draw, time.monotonic)
        self._period = period
        self._last = Refresh(0, time.monotonic())
        self._wanted = 0
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._on_timeout)
        self._refreshes: RefreshEvents | None = None
        try:
            self._refreshes = RefreshEvents(display, window)
        except XError:
            # Play by the clock instead, which doesn't know the phase of the screen's refreshes.
            self._request_refresh(0)
            return
        self._notifier = QSocketNotifier(
            self._refreshes.x.fileno(), QSocketNotifier.Type.Read, self
        )
        self._notifier.activated.connect(self.process_refreshes)
        self._request_refresh(0)

    @property
    def paced_by(self) -> str:
        return "the clock" if self._refreshes is None else "the screen's refreshes"

    def process_refreshes(self, *_: object) -> None:
        """Draw the frames that are due after the reported refreshes."""
        try:
            while (
                self._refreshes is not None and (told := self._refreshes.poll_refresh()) is not None
            ):
                self._on_refresh(told)
        except XError:
            self._close_refreshes()

    def stop(self) -> None:
        self._timer.stop()
        self._close_refreshes()

    def _on_refresh(self, refresh: Refresh) -> None:
        self._last = refresh
        self._request_refresh(self.player.on_refresh(*refresh))

    def _request_refresh(self, number: int) -> None:
        self._wanted = number
        due = self._last.time + (number - self._last.number) * self._period - time.monotonic()
        if self._refreshes is not None:
            self._refreshes.request_refresh(number)
            # After 0.25 s without an event, the refresh is taken from the clock.
            due += 0.25
        self._timer.start(max(0, round(due * 1e3)))

    def _on_timeout(self) -> None:
        """Compute the latest refresh from the clock, and continue the count."""
        now = time.monotonic()
        passed = math.floor((now - self._last.time) / self._period)
        # A timer may fire half a millisecond early.
        number = max(self._wanted, self._last.number + passed)
        since = (number - self._last.number) * self._period
        self._on_refresh(Refresh(number, self._last.time + since))

    def _close_refreshes(self) -> None:
        if self._refreshes is not None:
            self._notifier.setEnabled(False)
            self._refreshes.close()
            self._refreshes = None
