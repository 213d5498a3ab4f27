"""A thread that runs functions one after the other and may be abandoned."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import Empty, SimpleQueue
from typing import Any

Job = tuple[Callable[[], Any], "Future[Any]"]


class Worker:
    """Run functions in one daemon thread, so that a function that hangs doesn't block the program.

    Neither the caller nor the program's exit has to wait for it. name: of the thread, in
    tracebacks.
    """

    def __init__(self, name: str) -> None:
        self._jobs: SimpleQueue[Job | None] = SimpleQueue()
        self._ended = False
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    @property
    def has_ended(self) -> bool:
        """Whether no more calls are accepted."""
        return self._ended

    def submit(self, work: Callable[[], Any]) -> Future[Any]:
        """Queue a call; return its future, which is cancelled if the thread has ended."""
        done: Future[Any] = Future()
        with self._lock:
            if self._ended:
                _cancel(done)
            else:
                self._jobs.put((work, done))
        return done

    def end(self) -> None:
        """End the thread after the calls that were submitted."""
        with self._lock:
            if not self._ended:
                self._ended = True
                self._jobs.put(None)

    def give_up(self) -> None:
        """End the thread after its present call, and cancel the other calls."""
        with self._lock:
            self._ended = True
            try:
                while True:
                    job = self._jobs.get_nowait()
                    if job is not None:
                        _cancel(job[1])
            except Empty:
                self._jobs.put(None)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            work, done = job
            if not done.set_running_or_notify_cancel():
                continue
            try:
                done.set_result(work())
            except BaseException as error:
                done.set_exception(error)
            # A kept result would keep a frame alive until the next one comes.
            del job, work, done


def _cancel(done: Future[Any]) -> None:
    done.cancel()
    # cancel() alone doesn't wake concurrent.futures.wait(); this call does.
    done.set_running_or_notify_cancel()
