"""Commands in processes that may take little memory: each ends well, or says what lacks."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from hostile.running import _prepare
from small_bench.files import write_tiny

from figures import Figure
from figures.where import PACKAGES

_ADDRESSES = (120, 250, 400, 550, 650, 750, 850, 1000, 1150, 1300)
"""Megabytes of addresses: a command's first libraries take 100, all of them 1,200."""

_DATA = (30, 90, 150, 200, 250, 300, 350, 400, 450, 600)

_BENCH = ("--bench", "{0}/bench.toml")
_COMMANDS = (
    ("run", "{0}/plan.toml", *_BENCH, "--scene", "{0}/scene.toml", "--out", "{0}/new.h5",
     "--force"),
    ("report", "{0}/run.h5", "--out", "{0}/report", "--force"),
    ("reconstruct", "{0}/picture.png", "--psf", "{0}/psf.npy", "--out", "{0}/out.png", "--force"),
    ("simulate", "{0}/scene.toml", *_BENCH, "--out", "{0}/picture.tiff", "--force"),
    ("psf", "--camera", "{0}/bench.toml", "--size", "64", "--out", "{0}/p.npy", "--force"),
    ("export", "{0}/run.h5", "--to", "tiff", "--out", "{0}/frames", "--force"),
)  # fmt: skip

_SECONDS = 60.0

_SENTENCE = re.compile(r"there isn't enough memory: .+ needs? .+\. (Ask|Raise)")


def memory_limits_figure(folder: Path) -> list[Figure]:
    """Each limit with two of the commands, in turn."""
    found = list(try_limits(folder))
    fates = Counter(fate.split(":")[0] for *_, fate in found)
    bad = [one for one in found if one[2] not in ("well", "named")]
    said = ", ".join(f"{count} {name}" for name, count in sorted(fates.items()))
    first = f"; {bad[0]}" if bad else ""
    return [
        Figure(
            f"{len(found)} commands with limits of memory: unexpected, tracebacks, signals, hung",
            "0",
            f"{len(bad)} ({said}){first}",
            not bad,
        )
    ]


def try_limits(folder: Path, step: int = 1) -> Iterator[tuple[str, str, str]]:
    """Yield command, limit and fate. step: 1 for all of the limits."""
    write_tiny(folder)
    _prepare(folder)
    (folder / "report").mkdir(exist_ok=True)
    limits = [(resource.RLIMIT_AS, "addresses", size) for size in _ADDRESSES]
    limits += [(resource.RLIMIT_DATA, "data", size) for size in _DATA]
    for number, (kind, name, size) in enumerate(limits[::step]):
        for command in (_COMMANDS[number % 6], _COMMANDS[(number + 3) % 6]):
            words = [word.format(folder) for word in command]
            yield command[0], f"{size} MB of {name}", _fate(words, kind, size * 10**6)


def _fate(words: list[str], kind: int, size: int) -> str:
    """ "well", "named", or what a person must never meet."""
    environment = os.environ | {"PYTHONPATH": PACKAGES, "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "labapp", *words],
            capture_output=True,
            text=True,
            timeout=_SECONDS,
            env=environment,
            preexec_fn=lambda: resource.setrlimit(kind, (size, size)),
        )
    except subprocess.TimeoutExpired:
        return "hung"
    said = done.stderr
    if done.returncode == 0 and "Traceback" not in said:
        return "well"
    clean = not re.search(r"unexpected |Traceback|Exception ignored|terminate called", said)
    if done.returncode == 1 and clean and _SENTENCE.search(said):
        return "named"
    return f"bad: exit {done.returncode}: {said[-300:]}"


MEASUREMENTS = {"memory limits": memory_limits_figure}
