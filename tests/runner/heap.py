"""What tests have freed goes back to the system, before the next test needs as much again."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest

from labapp.memory import give_back_freed_memory

_MUCH = 700 << 20
"""Bytes that a process may hold after a test before it looks what it can do without."""


class Heap:
    """A plugin for where tests run."""

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logfinish(self) -> None:
        if resident() > _MUCH:
            gc.collect()
            give_back_freed_memory()


def resident() -> int:
    """Bytes of memory that this process holds."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
