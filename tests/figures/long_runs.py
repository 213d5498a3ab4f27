"""Runs of many small frames: memory and processor time that each frame costs, by command."""

from __future__ import annotations

import os
import subprocess
import sys
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
class _Cost:
    """What a command took: the largest process's memory in bytes, and seconds of all of them."""

    memory: float
    seconds: float


def long_runs(folder: Path) -> list[Figure]:
    """Two runs of one plan that differ by its repeats, and what else is done with their records."""
    (folder / "bench.toml").write_text(bench_text(_SIZE))
    (folder / "scene.toml").write_text(scene_text().split("[targets.photograph]")[0])
    few, many = (_costs(folder, frames) for frames in (_FEW, _MANY))
    return [_figure(name, few[name], many[name]) for name in few]


def _figure(name: str, few: _Cost, many: _Cost) -> Figure:
    more = _MANY - _FEW
    memory = (many.memory - few.memory) / more
    milliseconds = 1e3 * (many.seconds - few.seconds) / more
    return Figure(
        f"{name} of {_FEW:,} to {_MANY:,} frames of 64²: memory and processor time of a frame",
        f"≤ {_MOST_BYTES:g} bytes; ≤ {_MOST_MILLISECONDS:g} ms",
        f"{memory:.0f} bytes; {milliseconds:.2f} ms",
        memory <= _MOST_BYTES and milliseconds <= _MOST_MILLISECONDS,
    )


def _costs(folder: Path, frames: int) -> dict[str, _Cost]:
    """Costs by command; every record is in order, and every frame the one that HDF5 reads."""
    record = folder / f"{frames}.h5"
    plan = folder / f"{frames}.toml"
    plan.write_text(_drawn_plan(frames))
    bench = ("--bench", folder / "bench.toml", "--scene", folder / "scene.toml")
    found = {"run": _cost("run", plan, *bench, "--out", record)}
    before = _damage(record)
    found["resume"] = _cost("resume", record)
    assert np.array_equal(_sample(record), before), "frames that were taken again differ"
    found["verify"] = _cost("verify", record)
    found["show"] = _cost("show", record)
    for kind in ("npy", "ome-tiff"):
        found[f"export to {kind}"] = _cost("export", record, "--to", kind, "--out", folder / kind)
        if kind == "npy":
            array = np.load(folder / kind / "frames.npy", mmap_mode="r")
            assert len(array) == frames
            assert np.array_equal(array[:: frames // 100], before), "exported frames differ"
        for file in (folder / kind).iterdir():
            file.unlink()
    record.unlink()
    return found


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


def _damage(record: Path) -> np.ndarray:
    """Flip a bit of some frames' images; return some of the images as they were."""
    before = _sample(record)
    with h5py.File(record, "r+") as file:
        images = file["entry/data/images"]
        assert file["entry/data/stored"][()].all()
        offset, size, count = images.id.get_offset(), 2 * 64 * 64, len(images)
    with record.open("r+b") as data:
        for index in range(0, count, _DAMAGED):
            data.seek(offset + index * size)
            byte = data.read(1)[0]
            data.seek(offset + index * size)
            data.write(bytes([byte ^ 1]))
    return before


def _sample(record: Path) -> np.ndarray:
    with h5py.File(record, "r") as file:
        images = file["entry/data/images"]
        found: np.ndarray = images[:: len(images) // 100]
        return found


def _cost(*words: object) -> _Cost:
    command = [sys.executable, "-m", "labapp", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        said = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, f"{words[0]}: {said.decode()[-500:]}"
    return _Cost(1024.0 * used.ru_maxrss, used.ru_utime + used.ru_stime)


MEASUREMENTS = {"long runs": long_runs}
