"""How long tests took the last time, kept in pytest's cache: the longest begin first."""

from __future__ import annotations

from statistics import fmean

import pytest

from runner.costs import function

_KEY = "runner/seconds"


class Durations:
    """Seconds of each test function, in the mean of its cases."""

    def __init__(self, config: pytest.Config) -> None:
        self._cache = getattr(config, "cache", None)
        self._known: dict[str, float] = self._cache.get(_KEY, {}) if self._cache else {}
        self._usual = fmean(self._known.values()) if self._known else 1.0

    def of(self, test: str) -> float:
        return self._known.get(function(test), self._usual)

    def keep(self, seconds: dict[str, float]) -> None:
        if self._cache:
            self._cache.set(_KEY, self._known | seconds)
