"""What tests have freed goes back to the system, before the next test needs as much again.

What stays to the end, libraries and the tests themselves, isn't looked through for garbage.
"""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest

from labapp.common.memory import give_back_freed_memory

_MUCH = 500 << 20
"""Bytes by which a process may grow before it looks what it can do without: looking takes a good
part of a second, so what stays isn't looked at after every test."""


class Heap:
    """A plugin for where tests run."""

    def __init__(self) -> None:
        self._needed = 0

    @pytest.hookimpl(trylast=True)
    def pytest_collection_finish(self) -> None:
        gc.collect()
        gc.freeze()

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logfinish(self) -> None:
        if resident() > self._needed + _MUCH:
            gc.collect()
            give_back_freed_memory()
            self._needed = resident()


def resident() -> int:
    """Bytes of memory that this process holds."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
