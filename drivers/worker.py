"""A thread that does one thing after the other, and may be given up."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any

Job = tuple[Callable[[], Any], "Future[Any]"]


class Worker:
    """One daemon thread: a call that never ends hinders neither its caller nor the exit.

    name: of the thread, in tracebacks.
    """

    def __init__(self, name: str) -> None:
        self._jobs: SimpleQueue[Job | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def submit(self, work: Callable[[], Any]) -> Future[Any]:
        """Have something done after what was submitted before."""
        done: Future[Any] = Future()
        self._jobs.put((work, done))
        return done

    def end(self) -> None:
        """Let the thread end when it has done, if ever, what it does now."""
        self._jobs.put(None)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            work, done = job
            try:
                done.set_result(work())
            except BaseException as error:
                done.set_exception(error)
            # A kept result would keep a frame alive until the next one comes.
            del job, work, done
