"""What it costs to merge large exposure brackets from files: time beside a plain weighted average,
and memory of `labapp merge`."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import tifffile

from figures import Figure
from figures.own_memory import own_memory
from figures.stopwatch import processor_seconds
from figures.where import ENVIRONMENT, ROOT
from optics.camera import Sensor
from optics.hdr import Bracket, Method, merge
from optics.threads import single_threaded

_SHAPE, _FRAMES = (3000, 4000), 8
_TIMES = [1e-3 * 2**k for k in range(_FRAMES)]
_TIMES_GOAL, _MEMORY_GOAL = 4.0, 600e6
_SENSOR = Sensor(
    shape=_SHAPE, bits=16, full_well=3e5, gain=4.0, read_noise=5.0, dark_current=0.0,
    black_level=256.0,
)  # fmt: skip


@single_threaded
def bracket_cost_figures(folder: Path) -> list[Figure]:
    """Eight frames of 12 megapixels, each pixel with a light of its own over five decades."""
    rng, files = np.random.default_rng(20261127), []
    rate = 10 ** rng.uniform(2, 7.5, _SHAPE).astype(np.float32)
    for number, time in enumerate(_TIMES):
        light = rate * np.float32(time)
        light += rng.standard_normal(_SHAPE, dtype=np.float32) * np.sqrt(light + 25)
        frame = np.clip(np.round(light / 4 + 256), 0, 65535).astype(np.uint16)
        files.append(folder / f"{number}.tiff")
        tifffile.imwrite(files[-1], frame)
    return [*_time_figures(files), _memory_figure(files, folder / "merged.h5")]


def _time_figures(files: list[Path]) -> list[Figure]:
    def merged(method: Method) -> None:
        frames = [tifffile.imread(path) for path in files]
        merge(Bracket(frames, _TIMES, [256.0] * _FRAMES, [math.inf] * _FRAMES, _SENSOR), method)

    def averaged() -> None:
        _weighted_average([tifffile.imread(path) for path in files])

    jobs = {"full": lambda: merged("full"), "plain": lambda: merged("plain"), "bare": averaged}
    spent = processor_seconds(jobs, 5)
    return [
        Figure(
            f"12 megapixels x 8 from files, processor time over {what}",
            f"≤ {_TIMES_GOAL:g}",
            f"{spent['full'] / spent[name]:.1f} times; {spent['full']:.2f} s",
            spent["full"] / spent[name] <= _TIMES_GOAL,
        )
        for name, what in (
            ("plain", "that of the method plain, which gives variance and state too"),
            ("bare", "that of a bare weighted mean in tiles"),
        )
    ]


def _weighted_average(frames: list[np.ndarray]) -> np.ndarray:
    """Frames weighted by their time where they aren't clipped, eight rows at a time: a bare mean,
    with neither variance nor state."""
    found = np.empty(_SHAPE, np.float32)
    for start in range(0, _SHAPE[0], 8):
        rows = slice(start, start + 8)
        above, below = np.zeros((2, 8, _SHAPE[1]), np.float32)
        for frame, time in zip(frames, _TIMES, strict=True):
            weight = (frame[rows] < 65535) * np.float32(time)
            above += weight * (frame[rows].astype(np.float32) - 256) * np.float32(4)
            below += weight * np.float32(time)
        found[rows] = above / np.maximum(below, np.float32(1e-9))
    return found


def _memory_figure(files: list[Path], out: Path) -> Figure:
    """The command as a process of its own, over what it has after its imports."""
    done = subprocess.run(
        [sys.executable, "-m", "figures.bracket_cost", *map(str, files), "--exposures",
         ",".join(map(str, _TIMES)), "--gain", "4", "--read-noise", "5", "--black", "256",
         "--out", str(out)],
        cwd=ROOT, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    seen = float(done.stdout.splitlines()[-1])
    return Figure(
        "labapp merge of 12 megapixels x 8, memory above the imported process",
        f"≤ {_MEMORY_GOAL / 1e6:g} MB",
        f"{seen / 1e6:.0f} MB",
        seen <= _MEMORY_GOAL,
    )


def _main(arguments: list[str]) -> None:
    """Merge, and print how many bytes that took at most."""
    import labapp.pictures.merging.merge_command  # noqa: F401
    from labapp.cli import app

    before = own_memory("VmRSS")
    app(["merge", *arguments], standalone_mode=False)
    print(own_memory("VmHWM") - before)


MEASUREMENTS = {"bracket-cost": bracket_cost_figures}


if __name__ == "__main__":
    _main(sys.argv[1:])
