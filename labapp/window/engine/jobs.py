"""Register of background jobs, with their progress and a way to cancel."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from labapp.window.engine.change_notifier import REPORT_INTERVAL
from labapp.window.engine.channel import Channel
from labapp.window.messages import JobEnded, JobProgress
from optics.progress import Progress


class Jobs:
    """Register background jobs by name; any thread may call `cancel()`."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._lock = threading.Lock()
        self._running: dict[str, Progress] = {}
        self.on_progress: Callable[[JobProgress], None] = lambda _: None

    def is_running(self, job: str) -> bool:
        return job in self._running

    def begin(self, job: str) -> Progress:
        """Register a job, cancel an older one of its name, and return the new job's progress."""
        progress = Progress(_Reporter(job, self._report))
        with self._lock:
            if job in self._running:
                self._running[job].cancel()
            self._running[job] = progress
        return progress

    def _report(self, progress: JobProgress) -> None:
        self._channel.send(progress)
        self.on_progress(progress)

    def end(self, job: str, progress: Progress) -> None:
        """Tell the window that a job is over, unless a newer one of its name is running."""
        with self._lock:
            if self._running.get(job) is not progress:
                return
            del self._running[job]
        self._channel.send(JobEnded(job))

    def cancel(self, job: str | None = None) -> None:
        """Cancel the background job of this name, or all of them if it is None."""
        with self._lock:
            for name, progress in self._running.items():
                if job in (None, name):
                    progress.cancel()


class _Reporter:
    """Send a job's progress to the window, with its time left, as fast as a person can read."""

    def __init__(self, job: str, report: Callable[[JobProgress], None]) -> None:
        self._job, self._report = job, report
        self._began = time.monotonic()
        self._last = 0.0

    def __call__(self, fraction: float, message: str) -> None:
        now = time.monotonic()
        if now - self._last < REPORT_INTERVAL and fraction < 1:
            return
        self._last = now
        left = None
        # The time left can be estimated once 3 % of the job are done.
        if fraction > 0.03:
            left = (now - self._began) * (1 - fraction) / fraction
        self._report(JobProgress(self._job, fraction, message, left))
