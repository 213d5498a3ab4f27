"""Freed memory serves again, and goes back to the system when a bench has closed."""

import ctypes
import resource
import sys

import forked
import pytest
from small_bench.files import Size, bench_text

_FAULTS = """
import resource, sys
import torch
from labapp.common.memory import keep_freed_memory
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


glibc = pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="another C library")


@glibc
def test_large_arrays_take_the_memory_of_those_before_them():
    assert faults("kept") < faults("given back") / 2


_RUNS = """
import sys
from pathlib import Path
from labapp.runs.acquisition.runner import run_plan
from labapp.bench.opening import BenchFiles, open_bench
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.common.memory import keep_freed_memory

keep_freed_memory()
folder = Path(sys.argv[1])

def run(bench, record):
    # `opened` is still there when the process' pages are counted.
    with open_bench(BenchFiles(folder / bench, folder / "scene.toml")) as opened:
        run_plan(opened, read_file(folder / "plan.toml", PlanFile), folder / record)
    with open("/proc/self/statm") as counts:
        return int(counts.read().split()[1])

print(*(run(f"{bench}.toml", f"{n}.h5") for n, bench in enumerate(["bench"] + 3 * ["large"])))
"""

_TWO_FRAMES = """
version = 1
title = "Two frames"
[patterns.neutral]
kind = "constant"
[patterns.lens]
kind = "lens"
focal_length_m = 50.0
[[acquire]]
targets = ["star"]
patterns = ["neutral", "lens"]
wavelengths_nm = [550]
exposures_ms = [1]
"""


@glibc
def test_a_bench_that_has_closed_gives_its_memory_back(small):
    large = Size(panel=(432, 768), panel_pitch_um=20.0)
    (small.folder / "large.toml").write_text(bench_text(large))
    small.plan.write_text(_TWO_FRAMES)
    done = forked.run(
        [sys.executable, "-c", _RUNS, str(small.folder)], capture_output=True, text=True, check=True
    )
    page = resource.getpagesize()
    # The first run has loaded what every run needs. A run keeps 150 MB while its bench is open;
    # a third of it lost in each would show, and what threads leave of gaps doesn't.
    before, *after = (int(count) * page / 1e6 for count in done.stdout.split())
    assert max(after) < before + 50
