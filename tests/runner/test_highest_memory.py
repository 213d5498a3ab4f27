"""What all processes of a run hold at most, for the line at its end."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from runner.processes import HighestMemory

_SIZE = 100 << 20

_CHILD = f"""
import os
held = b"x" * {_SIZE}
reading, writing = os.pipe()
if not os.fork():
    os.close(writing)
    os.read(reading, 1)  # ends with the process that it shares the memory with
    os._exit(0)
print(os.getpid(), flush=True)
input()
"""


def test_memory_that_two_processes_share_is_counted_once():
    memory = HighestMemory(os.getpid())
    memory.look()
    before = memory.seen
    with subprocess.Popen(
        [sys.executable, "-c", _CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        assert int(child.stdout.readline()) == child.pid
        memory.look()
        child.communicate("\n")
    assert memory.seen - before == pytest.approx(_SIZE, rel=0.5)
    memory.look()
    assert memory.seen - before == pytest.approx(_SIZE, rel=0.5)
