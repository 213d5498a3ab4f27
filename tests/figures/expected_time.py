"""That a run behind real connections takes the time that was expected."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from figures import Figure
from figures.where import ENVIRONMENT, ROOT

_PLANS = ("psf-over-wavelengths", "photon-transfer", "SHORT")

_LOW, _HIGH = 0.7, 1.5
"""Expected over real time, at least and at most."""

_STARTS_WITHIN = 120.0
"""Seconds after which a bench that isn't served won't be."""

_SHORT = """
version = 1
title = "Short frames of many settings"
[patterns]
neutral = { kind = "constant" }
lens = { kind = "lens", focal_length_m = 40.0 }
[[acquire]]
targets = ["star"]
patterns = ["neutral", "lens"]
wavelengths_nm = [510, 560, 610]
exposures_ms = [10, 100]
repeats = 2
"""


def over_wires(folder: Path) -> list[Figure]:
    """Three plans on the virtual bench that is served to the drivers of real devices."""
    short = folder / "short.toml"
    short.write_text(_SHORT)
    with served_bench(folder) as bench:
        if bench is None:
            return [_figure("the bench can't be served here", None)]
        names = [str(short) if name == "SHORT" else name for name in _PLANS]
        ratios = [_ratio(name, bench, folder / "run.h5") for name in names]
    told = ", ".join(f"{ratio:.2f}" for ratio in ratios)
    return [_figure(told, all(_LOW <= ratio <= _HIGH for ratio in ratios))]


def _figure(measured: str, met: bool | None) -> Figure:
    name = "expected over real time of a run, three plans on the served bench"
    return Figure(name, f"{_LOW:g} to {_HIGH:g}", measured, met)


@contextmanager
def served_bench(folder: Path, *options: str | Path) -> Iterator[Path | None]:
    """The bench file of a virtual bench that is served while the block runs; None without one.

    options: more options of the command that serves it.
    """
    bench = folder / "bench.toml"
    serve = ["virtual-bench", "serve", "--until-eof", "--out", bench, *options]
    with subprocess.Popen(
        [sys.executable, "-m", "labapp", *serve],
        cwd=ROOT,
        env=ENVIRONMENT | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdin is not None
        late = time.monotonic() + _STARTS_WITHIN
        while not bench.exists() and process.poll() is None and time.monotonic() < late:
            time.sleep(0.1)
        if bench.exists():
            process.stdin.write("target star\n")
            process.stdin.flush()
        yield bench if bench.exists() else None
        process.stdin.close()


def _ratio(plan: str, bench: Path, record: Path) -> float:
    """What a run said beforehand over what it took, both in seconds."""
    options = ["--bench", bench, "--yes", "--json", "--force", "--out", record]
    done = subprocess.run(
        [sys.executable, "-m", "labapp", "run", plan, *options],
        cwd=ROOT,
        env=ENVIRONMENT | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=True,
    )
    told = json.loads(done.stdout)
    return float(told["expected_s"]) / float(told["took_s"])


MEASUREMENTS = {"expected time": over_wires}
