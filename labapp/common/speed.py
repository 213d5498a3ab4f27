"""Measures this machine's speed by timing the methods of optics, and keeps it in a file."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import finufft
import numpy as np
import scipy
import scipy.optimize
import scipy.special
import torch

from optics.accuracy import MachineSpeed
from optics.camera import Lens
from optics.camera.stop import Stop, regular_polygon
from optics.camera.stop_areas import open_arcs
from optics.fourier import FourierGeometry, NonuniformTransform, valid_transforms
from optics.plane import Plane
from optics.progress import Progress
from optics.psf import PSFOperator
from optics.sensor import PixelIntegration
from optics.threads import single_threaded

_REPEATS = 5
"""Timed calls of each job; chosen."""

_SLOWNESS = np.linspace(1.2, 3.0, 19)
"""Candidate ratios of double to single precision's time."""

_STEPS_PER_CIRCLE = 3
"""Steps of Python in which a hexagon's arcs on a circle are found: half a step for each edge, as
in `optics.camera.stop_nodes.rule_seconds`."""

_NEW_BYTES = (48 << 20, 96 << 20)
"""Memory that jobs fill, more than allocators keep from call to call; chosen."""

_JOBS_VERSION = 2
"""Counts changes of the jobs: speeds that other jobs measured are measured again."""

_BUSY = 0.5
"""Load per processor above which other processes slow the measurement; chosen."""


@dataclass(frozen=True)
class BenchmarkJob:
    """A call to time, and its cost as a sum over the speeds."""

    name: str
    cost: Callable[[MachineSpeed], float]
    call: Callable[[], Any]


def machine_speed(progress: Progress | None = None) -> MachineSpeed:
    """Return this machine's speed from its file, or measure it, which takes a few seconds.

    A speed that was measured on a busy machine is measured again once the load has halved.
    """
    # The load is that per processor over the last minute.
    kept, load = _read(), os.getloadavg()[0] / (os.cpu_count() or 1)
    if kept is not None and not (kept[1] > _BUSY and load < kept[1] / 2):
        return kept[0]
    speed = fit_speed(time_jobs(benchmark_jobs(), progress or Progress()))
    save_speed(speed, load)
    return speed


def speed_file_path() -> Path:
    """Return where the measured speed is kept; $XDG_CACHE_HOME moves it."""
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(cache) / "labapp" / "speed.json"


def _machine_fingerprint() -> dict[str, str]:
    """Identify machine, libraries and jobs: after any change, a stored speed is invalid."""
    return {
        "machine": platform.processor() or platform.machine(),
        "node": platform.node(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "torch": torch.__version__,
        "finufft": finufft.__version__,
        "jobs": str(_JOBS_VERSION),
    }


def _read() -> tuple[MachineSpeed, float] | None:
    """Read the stored speed and the load when it was measured; None if there is no valid one."""
    try:
        found = json.loads(speed_file_path().read_text())
        names = {field.name for field in fields(MachineSpeed)}
        if found["circumstances"] != _machine_fingerprint() or set(found["seconds"]) != names:
            return None
        speed = MachineSpeed(**{name: float(value) for name, value in found["seconds"].items()})
        return speed, float(found["load"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def save_speed(speed: MachineSpeed, load: float = 0.0) -> None:
    """Store a speed and the load per processor; if that fails, it is measured again."""
    kept = {"circumstances": _machine_fingerprint(), "load": load, "seconds": asdict(speed)}
    text = json.dumps(kept, indent=2)
    try:
        speed_file_path().parent.mkdir(parents=True, exist_ok=True)
        speed_file_path().write_text(text)
    except OSError:
        return


def benchmark_jobs() -> list[BenchmarkJob]:
    """Return jobs that cover every method at two sizes or more, and take some milliseconds each."""
    found: list[BenchmarkJob] = []
    rng = np.random.default_rng(0)
    for side, window, pitch in ((700, 200, 3e-6), (2000, 300, 2.5e-6), (300, 400, 3e-6)):
        geometry = FourierGeometry(
            Plane((side, side), (8e-6, 8e-6)), Plane((window,) * 2, (pitch,) * 2), 6e-8
        )
        for dtype in (torch.complex64, torch.complex128):
            field = torch.from_numpy(rng.normal(size=(side, side))).to(dtype)
            for transform in valid_transforms(geometry, dtype, 1e-4):
                name = f"{transform.name}, {side}² to {window}², {dtype}"
                found.append(BenchmarkJob(name, transform.cpu_seconds, partial(transform, field)))
    # A scale of 1024 × 8 µm × 3 µm makes the inverse of the step a whole number.
    geometry = FourierGeometry(
        Plane((700, 700), (8e-6, 8e-6)), Plane((200, 200), (3e-6, 3e-6)), 1024 * 2.4e-11
    )
    field = torch.ones(700, 700, dtype=torch.complex64)
    for transform in valid_transforms(geometry, torch.complex64)[2:]:
        found.append(BenchmarkJob(transform.name, transform.cpu_seconds, partial(transform, field)))
    found += [*_scattered_jobs(rng), *_axial_jobs(), *_kernel_jobs(rng)]
    for cutoff in (1e6, 2e5):
        integral = PixelIntegration(Plane((200, 200), (3e-6, 3e-6)), cutoff)
        light = torch.ones(integral.plane.shape)
        found.append(BenchmarkJob("whole pixels", integral.cpu_seconds, partial(integral, light)))
    return found


def _scattered_jobs(rng: np.random.Generator) -> list[BenchmarkJob]:
    found = []
    for points, window in ((100_000, 200), (20_000, 400), (200_000, 64)):
        angle, r = rng.uniform(0, 2 * np.pi, points), np.sqrt(rng.uniform(0, 1, points))
        order = np.lexsort((angle, np.round(100 * r)))
        y, x = (torch.from_numpy((5e-3 * r * f(angle))[order]) for f in (np.sin, np.cos))
        field = torch.ones(points, dtype=torch.complex128)
        for error in (1e-3, 1e-8):
            image = Plane((window, window), (3e-6, 3e-6))
            transform = NonuniformTransform(y, x, image, 6e-8, error)
            name = f"non-uniform FFT of {points}, {window}², {error:g}"
            found.append(BenchmarkJob(name, transform.cpu_seconds, partial(transform, field)))
    return found


def _kernel_jobs(rng: np.random.Generator) -> list[BenchmarkJob]:
    """Return jobs for what planning takes: kernels and Python."""
    found = []
    for count in (200_000, 800_000):
        angle = torch.from_numpy(300 * rng.random(count))
        bessel, steps = count // 4, count // 2000
        radii = np.linspace(0.1, 0.9, steps).tolist()
        found += [
            BenchmarkJob(
                f"{count} phasors",
                partial(_price, "cosine", 2 * count),
                # As the PSF of a lens computes them to judge its error.
                partial(lambda a: torch.complex(torch.cos(a), torch.sin(a)), angle),
            ),
            BenchmarkJob(
                f"{bessel} Bessel functions",
                partial(_price, "bessel", bessel),
                partial(scipy.special.j0, angle[:bessel].numpy()),
            ),
            BenchmarkJob(
                f"arcs of {steps} circles",
                partial(_price, "step", _STEPS_PER_CIRCLE * steps),
                partial(_find_arcs, radii),
            ),
        ]
    for size in _NEW_BYTES:
        name = f"{size >> 20} MB of new memory"
        # The first pass over a large result fills memory that isn't in use yet.
        fill = partial(torch.ones, size // 4, dtype=torch.float32)
        found.append(BenchmarkJob(name, partial(_price, "fresh", size), fill))
    return found


def _price(name: str, count: float, speed: MachineSpeed) -> float:
    """Return the processor seconds of `count` basic operations in one call."""
    return speed.call + count * float(getattr(speed, name))


def _find_arcs(radii: Sequence[float]) -> int:
    """Find the open arcs of a hexagonal stop, as a PSF's nodes need them."""
    stop = Stop(regular_polygon(6))
    return sum(len(open_arcs(stop, r)) for r in radii)


def _axial_jobs() -> list[BenchmarkJob]:
    found = []
    cases = ((256, 2.0, 5.6), (400, 0.5, 5.6), (16, 1e3, 8.0), (150, 0.3, 2.0))
    for size, distance, f_number in cases:
        pixels = Plane((size, size), (3.45e-6, 3.45e-6))
        lens = Lens(0.1, f_number, 2.0)
        operator = PSFOperator(
            lens, distance, 520e-9, pixels, integrate=False, tol=1e-6, method="axial"
        )
        found.append(BenchmarkJob(f"along the radius, {size}²", operator.cpu_seconds, operator))
    return found


@single_threaded
def time_jobs(jobs: list[BenchmarkJob], progress: Progress) -> list[tuple[BenchmarkJob, float]]:
    """Time the jobs in processor seconds, as the minimum over interleaved calls.

    Other processes can only add to a time (Chen and Revels, "Robust benchmarking in noisy
    environments", 2016).
    """
    seconds: dict[int, list[float]] = {number: [] for number in range(len(jobs))}
    for repeat in range(_REPEATS + 1):
        for number, job in enumerate(jobs):
            done = (repeat + number / len(jobs)) / (_REPEATS + 1)
            progress.report(done, "measuring how fast this machine is")
            started = time.process_time()
            job.call()
            # The first call isn't counted, because it prepares what the others reuse.
            if repeat:
                seconds[number].append(time.process_time() - started)
    return [(job, min(seconds[number])) for number, job in enumerate(jobs)]


def fit_speed(timings: list[tuple[BenchmarkJob, float]]) -> MachineSpeed:
    """Fit non-negative speeds to measured times, by the sum of squares of the relative errors."""
    names = [field.name for field in fields(MachineSpeed) if field.name != "double"]
    nothing = replace(MachineSpeed(), **dict.fromkeys(names, 0.0))
    best, least = MachineSpeed(), float("inf")
    for slowness in _SLOWNESS:
        prices = np.array(
            [
                [job.cost(replace(nothing, double=slowness, **{name: 1.0})) for name in names]
                for job, _ in timings
            ]
        )
        relative = prices / np.array([[seconds] for _, seconds in timings])
        scale = np.maximum(relative.max(axis=0), 1e-300)
        answer, residual = scipy.optimize.nnls(relative / scale, np.ones(len(timings)))
        if residual < least:
            least = residual
            values = dict(zip(names, (answer / scale).tolist(), strict=True))
            best = MachineSpeed(**values, double=float(slowness))
    return best
