"""Freed memory serves again, where the C library can be told so."""

import ctypes
import sys

import forked
import pytest

_FAULTS = """
import resource, sys
import torch
from labapp.memory import keep_freed_memory
if sys.argv[1] == "kept":
    keep_freed_memory()
def faults():
    for _ in range(10):
        torch.zeros(9_000_000).add_(1)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
print(-faults() + faults())
"""


def faults(how):
    """Pages that the system had to find for ten arrays of 36 MB, one after the other.

    Ten before them aren't counted: small things that stay may lie in the way of the first few.
    """
    done = forked.run(
        [sys.executable, "-c", _FAULTS, how], capture_output=True, text=True, check=True
    )
    return int(done.stdout)


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="another C library")
def test_large_arrays_take_the_memory_of_those_before_them():
    assert faults("kept") < faults("given back") / 2
