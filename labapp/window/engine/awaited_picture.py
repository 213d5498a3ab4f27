"""What the picture on the screen waits for, while it isn't one of the newest settings."""

from __future__ import annotations

import threading
import time

from labapp.window.engine.change_notifier import REPORT_INTERVAL
from labapp.window.engine.channel import Channel
from labapp.window.messages import JobProgress, PictureAwaited

_PATIENCE = 0.05
"""Seconds that a picture of a setting may take without a word: shorter ones would only flicker.
Chosen. That of a pattern never comes as soon."""

_SETTING = "setting the devices"
_PATTERN_JOB, _PATTERN = "pattern", "computing the pattern"


class AwaitedPicture:
    """Count the person's changes of settings, and tell the window until a picture of them comes.

    Each change has a number. A picture belongs to the number that was the newest when its exposure
    began, unless settings were still on their way then. Any thread may call the methods.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._condition = threading.Condition()
        self._newest = self._reached = 0
        self._is_live = False
        self._began, self._patience = 0.0, _PATIENCE
        self._activity, self._end = _SETTING, 0.0
        threading.Thread(target=self._tell, name="awaited-picture", daemon=True).start()

    @property
    def newest(self) -> int:
        """Return the number of the person's last change of a setting."""
        return self._newest

    @property
    def reached(self) -> int:
        """Return the number of the change that the newest picture belongs to."""
        return self._reached

    def count_request(self, *, is_pattern: bool = False) -> None:
        """Count a change of a setting, of which no picture can have come yet."""
        with self._condition:
            self._newest += 1
            self._began = time.monotonic()
            self._patience = 0.0 if is_pattern else _PATIENCE
            self._activity, self._end = _SETTING, 0.0
            self._condition.notify()

    def note_activity(self, request: int, activity: str, expected: float | None = None) -> None:
        """Note what is done for the picture, and in how many seconds it is expected."""
        with self._condition:
            if request == self._newest:
                self._activity = activity
                self._end = 0.0 if expected is None else time.monotonic() + expected

    def note_job(self, progress: JobProgress) -> None:
        """Note how far the computation of the pattern is."""
        if progress.job == _PATTERN_JOB:
            self.note_activity(self._newest, _PATTERN, progress.seconds_left)

    def note_picture(self, request: int) -> None:
        """Note that a picture that belongs to change number `request` is on its way."""
        with self._condition:
            self._reached = max(self._reached, request)

    def set_live(self, on: bool) -> None:
        """Note whether live view runs; nothing is awaited while it doesn't."""
        with self._condition:
            self._is_live = on
            self._condition.notify()

    def close(self) -> None:
        """Wake the thread, which ends once the window is gone."""
        with self._condition:
            self._condition.notify()

    def _tell(self) -> None:
        while not self._channel.closed:
            with self._condition:
                self._condition.wait_for(lambda: self._is_awaited or self._channel.closed)
                self._condition.wait_for(
                    lambda: self._channel.closed, self._began + self._patience - time.monotonic()
                )
                report = self._report() if self._is_awaited else None
            if report is not None:
                self._channel.send(report)
                time.sleep(REPORT_INTERVAL)

    @property
    def _is_awaited(self) -> bool:
        return self._is_live and self._reached < self._newest

    def _report(self) -> PictureAwaited:
        now = time.monotonic()
        left = self._end - now
        return PictureAwaited(
            self._newest, self._activity, now - self._began, left if left > 0 else None
        )
