"""Runs of many small frames: memory and processor time that each frame costs, by command."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from small_bench.files import Size, bench_text, scene_text

from figures import Figure

_FEW, _MANY = 10_000, 100_000
"""Frames of the two runs of which a frame's cost is the difference."""

_SIZE = Size((48, 64), 40.0, 40.0, (64, 64), 14.0)

_MOST_BYTES, _MOST_MILLISECONDS = 300.0, 2.0
"""Memory and processor time that a frame may cost a command."""

_DAMAGED = 2
"""Every so many frames lose a bit, so that `resume` has them to take."""

_PLAN = """
version = 1
title = "Long"
seed = {seed}
[patterns.neutral]
kind = "constant"
[patterns.lens]
kind = "lens"
focal_length_m = 50.0
[[acquire]]
targets = ["dark", "star"]
patterns = ["neutral", "lens"]
wavelengths_nm = [500, 532, 550, 600, 633]
exposures_ms = {exposures}
repeats = {repeats}
order = {order}
"""


@dataclass(frozen=True)
class Cost:
    """What a command took.

    memory: of the largest process, in bytes. seconds: of processor time, of all processes. wall:
    seconds that passed.
    """

    memory: float
    seconds: float
    wall: float


def long_runs(folder: Path) -> list[Figure]:
    """Two runs of one plan that differ by its repeats, and what else is done with their records."""
    few, many = (_costs(folder, frames) for frames in (_FEW, _MANY))
    return [_figure(name, few[name], many[name]) for name in few]


def _figure(name: str, few: Cost, many: Cost) -> Figure:
    more = _MANY - _FEW
    memory = (many.memory - few.memory) / more
    milliseconds = 1e3 * (many.seconds - few.seconds) / more
    return Figure(
        f"{name} of {_FEW:,} to {_MANY:,} frames of 64²: memory and processor time of a frame",
        f"≤ {_MOST_BYTES:g} bytes; ≤ {_MOST_MILLISECONDS:g} ms",
        f"{memory:.0f} bytes; {milliseconds:.2f} ms",
        memory <= _MOST_BYTES and milliseconds <= _MOST_MILLISECONDS,
    )


def _costs(folder: Path, frames: int) -> dict[str, Cost]:
    """Costs by command; every record is in order, and every frame the one that HDF5 reads."""
    record = folder / f"{frames}.h5"
    found = {"run": cost("run", *run_files(folder, frames), "--out", record)}
    before = damage(record, range(0, frames, _DAMAGED))
    found["resume"] = cost("resume", record)
    assert np.array_equal(sample(record), before), "frames that were taken again differ"
    found["verify"] = cost("verify", record)
    found["show"] = cost("show", record)
    for kind in ("npy", "ome-tiff"):
        found[f"export to {kind}"] = cost("export", record, "--to", kind, "--out", folder / kind)
        if kind == "npy":
            array = np.load(folder / kind / "frames.npy", mmap_mode="r")
            assert len(array) == frames
            assert np.array_equal(array[:: frames // 100], before), "exported frames differ"
        for file in (folder / kind).iterdir():
            file.unlink()
    record.unlink()
    return found


def run_files(folder: Path, frames: int) -> list[object]:
    """Write plan, bench and scene of a run of so many frames; return them as arguments."""
    plan, bench, scene = (folder / f"{one}.toml" for one in (frames, "bench", "scene"))
    plan.write_text(_drawn_plan(frames))
    bench.write_text(bench_text(_SIZE))
    scene.write_text(scene_text().split("[targets.photograph]")[0])
    return [plan, "--bench", bench, "--scene", scene]


def _drawn_plan(frames: int) -> str:
    rng = np.random.default_rng(55)
    exposures = sorted(rng.choice(np.arange(1, 40), 10, replace=False).tolist())
    order = rng.permutation(["target", "pattern", "wavelength", "exposure"]).tolist()
    return _PLAN.format(
        seed=int(rng.integers(1 << 16)),
        exposures=exposures,
        order=["repeat", *order],
        repeats=frames // (2 * 2 * 5 * len(exposures)),
    )


def damage(record: Path, which: Iterable[int]) -> np.ndarray:
    """Flip a bit of some frames' images; return a sample of all images as they were."""
    before = sample(record)
    with h5py.File(record, "r+") as file:
        images = file["entry/data/images"]
        assert file["entry/data/stored"][()].all()
        offset, size = images.id.get_offset(), 2 * 64 * 64
    with record.open("r+b") as data:
        for index in which:
            data.seek(offset + index * size)
            byte = data.read(1)[0]
            data.seek(offset + index * size)
            data.write(bytes([byte ^ 1]))
    return before


def sample(record: Path) -> np.ndarray:
    """Return a hundred of a record's images, evenly chosen, as HDF5 reads them."""
    with h5py.File(record, "r") as file:
        images = file["entry/data/images"]
        found: np.ndarray = images[:: len(images) // 100]
        return found


def cost(*words: object) -> Cost:
    """Run a command of labapp, and return what it took; it must succeed."""
    began = time.monotonic()
    command = [sys.executable, "-m", "labapp", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        said = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, f"{words[0]}: {said.decode()[-500:]}"
    return Cost(1024.0 * used.ru_maxrss, used.ru_utime + used.ru_stime, time.monotonic() - began)


MEASUREMENTS = {"long runs": long_runs}
