"""No test goes on for ever.

pytest-timeout raises an error in a test that is late. Where that is of no avail, in a library or
an event loop that doesn't return, or when what hangs is the clean-up, this process is ended after
some grace; it says before which test it was at, and where.
"""

from __future__ import annotations

import faulthandler
import os
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO

import pytest

from runner.processes import end_descendants

_SWEEP = 900.0
"""Seconds that a sweep may take, where it doesn't say how long."""

_COLLECTION = 600.0
"""Seconds that the collection of all tests may take."""

_LAST_WORD = 5.0
"""Seconds after which a process is ended that can't even say that it hangs."""

_BEAT = 0.5
"""Seconds between two looks at the clock. A thread for each test costs more than most tests do."""


@dataclass(frozen=True)
class _Limit:
    name: str
    seconds: float
    end: float


class Limits:
    """A plugin for where tests run. grace: seconds after a test's timeout. words: where to."""

    def __init__(self, config: pytest.Config, words: IO[str]) -> None:
        self._config, self._words = config, words
        self._grace = float(config.getini("grace"))
        self._limit: _Limit | None = None
        self._armed = 0.0
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._watch_the_clock, daemon=True)

    def pytest_sessionstart(self) -> None:
        faulthandler.enable(self._words)
        self._watch.start()

    def pytest_sessionfinish(self) -> None:
        self._over.set()
        self._watch.join()
        faulthandler.cancel_dump_traceback_later()

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        for item in items:
            if item.get_closest_marker("sweep") and not item.get_closest_marker("timeout"):
                item.add_marker(pytest.mark.timeout(_SWEEP))

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        with self._within(_COLLECTION, "the collection of tests"):
            return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        marker = item.get_closest_marker("timeout")
        seconds = marker.args[0] if marker else self._default()
        with self._within(seconds, item.nodeid):
            return (yield)

    def _default(self) -> float:
        return float(self._config.getoption("timeout") or self._config.getini("timeout") or 0)

    @contextmanager
    def _within(self, seconds: float, name: str) -> Iterator[None]:
        if seconds and not self._config.getoption("usepdb"):
            seconds += self._grace
            self._limit = _Limit(name, seconds, time.monotonic() + seconds)
            if seconds != self._armed:
                self._arm(seconds)
        try:
            yield
        finally:
            self._limit = None

    def pytest_enter_pdb(self) -> None:
        """Give a person all the time at a breakpoint."""
        self._limit = None

    def _watch_the_clock(self) -> None:
        while not self._over.wait(_BEAT):
            limit = self._limit
            if limit and time.monotonic() > limit.end:
                self._end(limit)
            if self._armed:
                self._arm(limit.seconds if limit else self._armed)

    def _arm(self, seconds: float) -> None:
        """End the process if a library keeps even the watch from running for so long."""
        self._armed = seconds
        faulthandler.dump_traceback_later(seconds + _LAST_WORD, exit=True, file=self._words)

    def _end(self, limit: _Limit) -> None:
        print(f"{limit.name} has not ended after {limit.seconds:g} s.", file=self._words)
        capture = self._config.pluginmanager.getplugin("capturemanager")
        printed = "".join(capture.read_global_capture()) if capture else ""
        print(printed, file=self._words, flush=True)
        faulthandler.dump_traceback(self._words)
        end_descendants(os.getpid())
        os._exit(1)
