"""Read a camera's stream through OpenCV in a separate thread.

A VideoCapture may be used by one thread only, and its calls may hang for ten seconds. All of them
are therefore made in this thread, and callers wait only as long as their own timeout. The thread
reads every frame as it comes, so that few frames wait in the system's queue (V4L2: four).
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as TookTooLong
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")

QUEUE_LENGTH = 4
"""Number of frames that V4L2 may hold in its queue, as OpenCV requests."""


@dataclass(frozen=True)
class StreamFrame:
    """A frame, with its time.monotonic().

    stamped: whether the time is the camera driver's own stamp, and not that of its arrival.
    """

    number: int
    time: float
    stamped: bool
    image: Any


class StreamStopped(Exception):
    """Raised if a stream has ended or can't begin; the message says why."""


class Stream:
    """Read a camera's frames from a VideoCapture in a thread, until stop() is called.

    Frames that no caller waits for are read and discarded.

    open_capture: opens the VideoCapture; it is called in the thread.
    """

    def __init__(self, open_capture: Callable[[], Any]) -> None:
        self._make = open_capture
        self._jobs: SimpleQueue[tuple[Callable[[Any], Any], Future[Any]]] = SimpleQueue()
        self._changed = threading.Condition()
        self._shot: StreamFrame | None = None
        self.end_reason = ""
        """Why the stream has ended; empty while it runs."""
        self._stopping = False
        self._wanted = 0
        self.frame_count = 0
        self.missing_count = 0
        """Number of missing frames, by the gaps between the times of the others."""
        self._times: deque[tuple[int, float]] = deque(maxlen=1000)
        self._last = 0.0
        self.period = 0.0
        """Measured seconds from frame to frame; 0 before there are two."""
        self.last_frame_at = time.monotonic()
        """When the last frame came, by time.monotonic()."""
        self._thread = threading.Thread(target=self._run, name="UVC stream", daemon=True)
        self._thread.start()

    def count_frames_since(self, time_: float, number: int) -> int:
        """Count the frames with times after `time_`, up to frame `number`."""
        with self._changed:
            return sum(1 for count, at in self._times if at > time_ and count <= number)

    def interval_before(self, number: int) -> float:
        """Return the seconds from the previous frame to frame `number`.

        Infinite if one of their times is unknown.
        """
        with self._changed:
            times = dict(self._times)
        return times.get(number, math.inf) - times.get(number - 1, -math.inf)

    def run_between_frames(self, work: Callable[[Any], T], seconds: float) -> T:
        """Run `work` on the VideoCapture between two frames; return its result.

        StreamStopped if the stream has ended or doesn't run it in time.
        """
        done: Future[T] = Future()
        self._jobs.put((work, done))
        late = time.monotonic() + seconds
        while not self.end_reason:
            try:
                return done.result(timeout=min(0.05, max(late - time.monotonic(), 0.001)))
            except TookTooLong:
                if time.monotonic() > late:
                    raise StreamStopped(f"it doesn't answer within {seconds:.2g} s") from None
        if done.done():
            return done.result()
        raise StreamStopped(self.end_reason)

    def next_shot(self, after: int, seconds: float) -> StreamFrame | None:
        """Wait for the first frame numbered above `after`; None if none comes.

        StreamStopped if the stream has ended.
        """
        with self._changed:
            self._wanted += 1
            try:
                self._changed.wait_for(lambda: self._has(after) or self.end_reason, seconds)
            finally:
                self._wanted -= 1
            if self._has(after):
                return self._shot
            if self.end_reason:
                raise StreamStopped(self.end_reason)
            return None

    def _has(self, after: int) -> bool:
        return self._shot is not None and self._shot.number > after

    def stop(self, seconds: float) -> bool:
        """End the stream and close the camera; return whether that was done in time."""
        self._stopping = True
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        capture = None
        try:
            capture = self._make()
            while not self._stopping:
                self._do_jobs(capture)
                self._grab_frame(capture)
            why = "it was stopped"
        except StreamStopped as stopped:
            why = str(stopped)
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
        finally:
            if capture is not None:
                capture.release()
        with self._changed:
            self.end_reason = why
            self._changed.notify_all()

    def _do_jobs(self, capture: Any) -> None:
        while True:
            try:
                work, done = self._jobs.get_nowait()
            except Empty:
                return
            try:
                done.set_result(work(capture))
            except Exception as error:
                done.set_exception(error)

    def _grab_frame(self, capture: Any) -> None:
        """Read one frame; decode it only if a caller waits for it."""
        if not capture.grab():
            raise StreamStopped("the stream broke off")
        now = time.monotonic()
        # Property 0 is cv2.CAP_PROP_POS_MSEC: with V4L2 the frame's time.monotonic() in ms.
        stamp = float(capture.get(0) or 0.0) * 1e-3
        # Some drivers set no time stamp, or use another clock.
        stamped = self._last < stamp <= now and now - stamp < 60
        at = stamp if stamped else now
        self.last_frame_at = now
        self.frame_count += 1
        with self._changed:
            self._times.append((self.frame_count, at))
        self._update_period(at)
        if not self._wanted:
            return
        good, image = capture.retrieve()
        with self._changed:
            if good and image is not None:
                self._shot = StreamFrame(self.frame_count, at, stamped, image)
            self._changed.notify_all()

    def _update_period(self, at: float) -> None:
        """Update the measured period, and count missing frames."""
        gap, self._last = at - self._last, at
        if self.frame_count < 2:
            return
        if self.period and gap > 1.5 * self.period:
            self.missing_count += round(gap / self.period) - 1
        # The period grows slowly, because a longer gap may be a lost frame, and shrinks faster.
        share = 0.05 if gap > self.period else 0.3
        self.period = gap if not self.period else self.period + share * (gap - self.period)
