"""The stream of a camera that OpenCV reads, in a thread of its own.

A VideoCapture may be used by one thread only, and its calls may hang for ten seconds; so all of
them are made here, and whoever waits for them waits no longer than it wants to. The thread takes
every frame as it comes, so that few wait in the queue of the system's driver (V4L2: four).
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

POS_MSEC = 0
"""cv2.CAP_PROP_POS_MSEC: with V4L2 the frame's time by time.monotonic(), in milliseconds."""

QUEUE_LENGTH = 4
"""Frames that V4L2 may hold ready, as OpenCV asks it to."""

_MAX_HISTORY = 1000
"""Frame times that are kept, for a look back."""


@dataclass(frozen=True)
class StreamFrame:
    """A frame as it came: when, by time.monotonic(), and whether the camera itself said so."""

    number: int
    time: float
    stamped: bool
    image: Any


class StreamStopped(Exception):
    """The stream has ended, in words."""


class Stream:
    """Frames of an opened VideoCapture, from start() to stop().

    open_capture: opens one, in the thread. Frames that nobody waits for are taken and forgotten.
    """

    def __init__(self, open_capture: Callable[[], Any]) -> None:
        self._make = open_capture
        self._jobs: SimpleQueue[tuple[Callable[[Any], Any], Future[Any]]] = SimpleQueue()
        self._changed = threading.Condition()
        self._shot: StreamFrame | None = None
        self.end_reason = ""
        """Why it has ended; empty while it goes on."""
        self._stopping = False
        self._wanted = 0
        self.frame_count = 0
        self.missing_count = 0
        """Frames that are missing, as the times of the others tell."""
        self._times: deque[tuple[int, float]] = deque(maxlen=_MAX_HISTORY)
        self._last = 0.0
        self.period = 0.0
        """Seconds from frame to frame, as they come; 0 before there are two."""
        self.last_frame_at = time.monotonic()
        """When the last frame came, by time.monotonic()."""
        self._thread = threading.Thread(target=self._run, name="UVC stream", daemon=True)
        self._thread.start()

    def count_frames_since(self, time_: float, number: int) -> int:
        """How many frames have times after `time_`, up to the one of that number."""
        with self._changed:
            return sum(1 for count, at in self._times if at > time_ and count <= number)

    def interval_before(self, number: int) -> float:
        """Seconds from the frame before to the one of that number; infinite where unknown."""
        with self._changed:
            times = dict(self._times)
        return times.get(number, math.inf) - times.get(number - 1, -math.inf)

    def run_between_frames(self, work: Callable[[Any], T], seconds: float) -> T:
        """Have something done with the VideoCapture between two frames.

        StreamStopped if the stream has ended or doesn't come to it in time.
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
        """The first frame of a number greater than `after` that comes; None if none does.

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
        """End the stream and close the camera; whether that was done in time."""
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
        """One frame: decoded only if somebody wants it."""
        if not capture.grab():
            raise StreamStopped("the stream broke off")
        now = time.monotonic()
        stamp = float(capture.get(POS_MSEC) or 0.0) * 1e-3
        # Some drivers stamp nothing, or by another clock.
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
        gap, self._last = at - self._last, at
        if self.frame_count < 2:
            return
        if self.period and gap > 1.5 * self.period:
            self.missing_count += round(gap / self.period) - 1
        # Slowly upwards, for a gap is no period; a shorter one is believed sooner.
        share = 0.05 if gap > self.period else 0.3
        self.period = gap if not self.period else self.period + share * (gap - self.period)
