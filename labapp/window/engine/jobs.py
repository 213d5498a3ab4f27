"""What the engine is busy with: progress that the window sees, and one way to cancel."""

from __future__ import annotations

import threading
import time

from labapp.window.engine.channel import Channel
from labapp.window.messages import JobEnded, JobProgress
from optics.progress import Progress

_INTERVAL = 0.1
"""Seconds between reports: more often than anybody reads only costs time."""

_ENOUGH = 0.03
"""Share of a job from which its time left can be told."""


class Jobs:
    """The jobs beside the bench, by name; `cancel()` may be called from any thread."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._lock = threading.Lock()
        self._running: dict[str, Progress] = {}

    def begin(self, job: str) -> Progress:
        """A progress whose reports go to the window; an older job of that name is cancelled."""
        progress = Progress(_Reporter(job, self._channel))
        with self._lock:
            if job in self._running:
                self._running[job].cancel()
            self._running[job] = progress
        return progress

    def end(self, job: str, progress: Progress) -> None:
        """Tell the window that a job is over, unless a newer one of its name goes on."""
        with self._lock:
            if self._running.get(job) is not progress:
                return
            del self._running[job]
        self._channel.send(JobEnded(job))

    def cancel(self) -> None:
        with self._lock:
            for progress in self._running.values():
                progress.cancel()


class _Reporter:
    """Sends reports on at a pace that a person can read, with the time that is left."""

    def __init__(self, job: str, channel: Channel) -> None:
        self._job, self._channel = job, channel
        self._began = time.monotonic()
        self._last = 0.0

    def __call__(self, fraction: float, message: str) -> None:
        now = time.monotonic()
        if now - self._last < _INTERVAL and fraction < 1:
            return
        self._last = now
        left = None
        if fraction > _ENOUGH:
            left = (now - self._began) * (1 - fraction) / fraction
        self._channel.send(JobProgress(self._job, fraction, message, left))
