"""How soon a run ends that is cancelled, and what it costs beside exposure and settling."""

from __future__ import annotations

import statistics
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from small_bench.setups import small_setup

from drivers.interfaces import Frame
from figures import Figure
from labapp.bench.opening import Bench, BenchSetup, open_bench
from labapp.files.plan_file import PlanFile
from labapp.files.writing import sync_to_disk
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.shots import Shot
from labapp.runs.state import State
from optics.progress import Progress
from simulator.devices import SimulatedCamera
from simulator.faults import Fault

_TIMES = 10
_LONG_GOAL, _HUNG_GOAL = 0.3, 2.0
_OVERHEAD_GOAL = 2e-3
_FRAMES = 200
_SUSTAINED, _REPEATS = 30, 7
_BIG = (3000, 4096)
_SUSTAINED_GOAL = 1.2


def plan_of(exposures_ms: list[float], repeats: int) -> PlanFile:
    """The star with the neutral pattern at one wavelength."""
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": "Star",
            "patterns": {"neutral": {"kind": "constant"}},
            "acquire": [
                {
                    "targets": ["star"],
                    "patterns": ["neutral"],
                    "wavelengths_nm": [550],
                    "exposures_ms": exposures_ms,
                    "repeats": repeats,
                }
            ],
        }
    )


def cancel_figure(folder: Path) -> list[Figure]:
    """From the wish to cancel to safe devices and CANCELLED in the file: the slowest."""
    hung = small_setup(faults=[Fault("camera", "hung")], reply_s=60.0)
    long = max(cancel_seconds(folder, small_setup(), n) for n in range(_TIMES))
    stuck = max(cancel_seconds(folder, hung, n) for n in range(_TIMES))
    return [
        Figure(
            "cancel during a 30 s exposure / with a hung camera",
            f"safe and CANCELLED within {_LONG_GOAL * 1e3:.0f} ms / {_HUNG_GOAL:.0f} s",
            f"{long * 1e3:.0f} ms / {stuck:.2f} s, slowest of {_TIMES}",
            long <= _LONG_GOAL and stuck <= _HUNG_GOAL,
        )
    ]


def cancel_seconds(folder: Path, setup: BenchSetup, number: int) -> float:
    """Seconds from the wish to cancel, in the middle of an exposure of 30 s in real time."""
    path, progress = folder / f"cancelled-{number}.h5", Progress()
    moments: dict[str, float] = {}

    def cancel() -> None:
        while not _is_running(path):
            time.sleep(0.01)
        time.sleep(0.2 + 0.05 * number)
        moments["asked"] = time.perf_counter()
        progress.cancel()
        while not (moments.get("safe") and _state(path).has_ended):
            time.sleep(0.001)
        moments["ended"] = time.perf_counter()

    path.unlink(missing_ok=True)
    with open_bench(setup, speed=1.0) as bench:
        make_safe = bench.make_safe

        def noted() -> Any:
            failures = make_safe()
            moments["safe"] = time.perf_counter()
            return failures

        bench.make_safe = noted  # type: ignore[method-assign]
        watcher = threading.Thread(target=cancel)
        watcher.start()
        outcome = run_plan(bench, plan_of([30_000], 2), path, Attendance(progress=progress))
        watcher.join()
        assert outcome.state is State.CANCELLED, outcome
        assert bench.slm.displayed_pattern == "neutral"
    return moments["ended"] - moments["asked"]


def _is_running(path: Path) -> bool:
    return path.exists() and _state(path) is State.RUNNING


def _state(path: Path) -> State:
    with Record(path) as record:
        return record.state


def overhead_figure(folder: Path) -> list[Figure]:
    """The median time from a frame to the next, less the camera's own, 512 x 512 pixels.

    The first run finds memory that nobody has used yet, which a virtual machine is slow to
    give, and isn't counted.
    """
    with open_bench(small_setup((512, 512), reply_s=30.0)) as bench, _timed_camera() as spent:
        runs = [_overheads(bench, folder / "overhead.h5", spent) for _ in range(1 + _REPEATS)]
    overhead = statistics.median(one for run in runs[1:] for one in run)
    return [
        Figure(
            "frame of 512² acknowledged, time beside exposure, settling and image formation",
            f"≤ {_OVERHEAD_GOAL * 1e3:.0f} ms median",
            f"{overhead * 1e3:.2f} ms, {_REPEATS} x {_FRAMES} frames",
            overhead <= _OVERHEAD_GOAL,
        )
    ]


def _overheads(bench: Bench, path: Path, spent: list[float]) -> list[float]:
    """Seconds of each frame of a run, less those in `spent`, which the camera adds up."""
    told: list[tuple[float, float]] = []
    plan = plan_of([1, 8, 64, 512], _FRAMES // 4)
    run_plan(
        bench,
        plan,
        path,
        Attendance(on_frame=lambda shot, frame: told.append((time.perf_counter(), spent[0]))),
    )
    path.unlink()
    ends, camera = np.array(told).T
    return (np.diff(ends) - np.diff(camera)).tolist()


@contextmanager
def _timed_camera() -> Iterator[list[float]]:
    """Seconds that simulated cameras have spent in capture(), while the block runs."""
    spent = [0.0]
    original = SimulatedCamera.capture

    def timed(self: SimulatedCamera, cancelled: Callable[[], bool]) -> Frame:
        began = time.perf_counter()
        try:
            return original(self, cancelled)
        finally:
            spent[0] += time.perf_counter() - began

    SimulatedCamera.capture = timed  # type: ignore[method-assign]
    try:
        yield spent
    finally:
        SimulatedCamera.capture = original  # type: ignore[method-assign]


def sustained_figure(folder: Path) -> list[Figure]:
    """Frames of 12 megapixels through the whole engine, against a plain HDF5 writer.

    Both until the data are on the disk; the camera has its pictures ready.
    """
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 4096, _BIG, dtype=np.uint16) for _ in range(4)]
    writers = {"plain": _plain, "ours": _engine}
    seconds: dict[str, list[float]] = {name: [] for name in writers}
    # The first ones find memory that nobody has used yet, which is slow, and aren't counted.
    for number in range(-1, _REPEATS):
        for name in sorted(writers, reverse=bool(number % 2)):
            took = writers[name](folder / f"{name}.h5", frames)
            if number >= 0:
                seconds[name].append(took)
    plain, ours = statistics.median(seconds["plain"]), statistics.median(seconds["ours"])
    ratio, rate = ours / plain, (_SUSTAINED - 1) * frames[0].nbytes / ours
    return [
        Figure(
            "12-megapixel frames to disk, time over that of a plain HDF5 writer",
            f"≤ {_SUSTAINED_GOAL:g}",
            f"{ratio:.2f} at {rate / 1e6:.0f} MB/s, {_REPEATS} x {_SUSTAINED} frames",
            ratio <= _SUSTAINED_GOAL,
        )
    ]


def _plain(path: Path, frames: list[NDArray[np.uint16]]) -> float:
    """Seconds from the first frame to the moment when all are on the disk."""
    path.unlink(missing_ok=True)
    shape = (_SUSTAINED, *_BIG)
    with h5py.File(path, "w", libver="latest") as file:
        images = file.create_dataset("images", shape, "u2", chunks=(1, *_BIG))
        file.swmr_mode = True
        for index in range(_SUSTAINED):
            images[index] = frames[index % len(frames)]
            file.flush()
            if index == 0:
                began = time.perf_counter()
        sync_to_disk(path)
        seconds = time.perf_counter() - began
    path.unlink()
    return seconds


def _engine(path: Path, frames: list[NDArray[np.uint16]]) -> float:
    """The same, of a run; that it reads everything back afterwards is beside the point."""
    path.unlink(missing_ok=True)
    told: list[float] = []

    def tell(shot: Shot, frame: Frame) -> None:
        if shot.index == _SUSTAINED - 1:
            sync_to_disk(path)
        told.append(time.perf_counter())

    with open_bench(small_setup(_BIG, reply_s=60.0)) as bench, _ready_pictures(frames):
        run_plan(bench, plan_of([1], _SUSTAINED), path, Attendance(on_frame=tell))
    path.unlink()
    return told[-1] - told[0]


@contextmanager
def _ready_pictures(frames: list[NDArray[np.uint16]]) -> Iterator[None]:
    """Simulated cameras form no image while the block runs: they have these, in turn."""
    original = SimulatedCamera._expose

    def ready(self: SimulatedCamera, cancelled: Callable[[], bool], other: float) -> Frame:
        self._number += 1
        image = frames[self._number % len(frames)]
        return Frame(image, self._exposure, 2.6, self._clock.now(), self._number)

    SimulatedCamera._expose = ready  # type: ignore[method-assign]
    try:
        yield
    finally:
        SimulatedCamera._expose = original  # type: ignore[method-assign]


MEASUREMENTS = {"cancel": cancel_figure, "overhead": overhead_figure, "sustained": sustained_figure}
