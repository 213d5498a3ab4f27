"""Two processes and one file: each does what it is asked to at the same time as the other.

A process that has its libraries loaded forks two for every schedule, and tells how it ended. The
two wait by chance before every call that opens, locks or moves a file, so that their steps
interleave in ever new ways.
"""

from __future__ import annotations

import fcntl
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from small_bench.setups import small_setup

from figures.fork_server import ForkServer
from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.writing import require_writable, write_atomically
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.export.exporting import export_frames
from labapp.runs.record.digests import image_digest
from optics.progress import Progress
from simulator.imaging import Imaging

SHAPE = (16, 20)
"""Of the sensor, (rows, columns)."""

FOREIGN = b"of another command"
"""What a command writes that makes no record."""


@dataclass
class Deed:
    """What one process did, and how it ended.

    title: of the run whose frames were stored. frames: digests of those, by index. first, last:
    when the first and the last was acknowledged, and placed: when a new file got the path, by a
    clock that all processes share; 0 if none was. process: its number. state: of a run, or what
    the others end with.
    """

    what: str
    title: str
    process: int = 0
    state: str = ""
    error: str = ""
    frames: dict[str, str] = field(default_factory=dict)
    first: float = 0.0
    last: float = 0.0
    placed: float = 0.0


class Rivals(ForkServer):
    """A context manager; takes schedules, two processes each."""

    def __init__(self) -> None:
        super().__init__("figures.rivals")

    def take(self, *works: dict[str, Any]) -> list[Deed]:
        """Do works, each in a process of its own, at the same time; how they ended.

        work: what, title, path, other (a record to export), seed, stop (frame after which a run is
        cancelled; -1 for none).
        """
        return [Deed(**data) for data in json.loads(self.ask(json.dumps(works)))]


def small_plan(title: str) -> PlanFile:
    """Six frames of the dark; the title decides about the seed."""
    block = {
        "targets": ["dark"],
        "patterns": ["neutral"],
        "wavelengths_nm": [550],
        "exposures_ms": [1],
        "repeats": 6,
    }
    table = {
        "version": 1,
        "title": title,
        "seed": sum(title.encode()),
        "patterns": {"neutral": {"kind": "constant"}},
        "acquire": [block],
    }
    return PlanFile.model_validate(table)


def _serve() -> None:
    _keep_effect_plans()
    with tempfile.TemporaryDirectory() as folder, open_bench(small_setup(SHAPE)) as bench:
        run_plan(bench, small_plan("first"), Path(folder, "run.h5"))
    print("ready", flush=True)
    for line in sys.stdin:
        print(json.dumps(_fork_all(json.loads(line))), flush=True)


def _keep_effect_plans() -> None:
    """Let processes that are forked later know which effects a frame calls for.

    All frames of the plan call for the same.
    """
    decide, known = Imaging.plan, []

    def plan(self: Imaging, situation: Any) -> Any:
        if not known:
            known.append(decide(self, situation))
        return known[0]

    Imaging.plan = plan


def _fork_all(works: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Fork a process for each work, let them begin together; what each did."""
    waiting, go = os.pipe()
    pipes = []
    for work in works:
        reading, writing = os.pipe()
        if not os.fork():
            os.close(go)
            os.read(waiting, 1)
            os.write(writing, json.dumps(asdict(_do(work))).encode())
            os._exit(0)
        os.close(writing)
        pipes.append(reading)
    os.close(waiting)
    os.close(go)
    found = []
    for reading in pipes:
        with open(reading, "rb") as file:
            found.append(json.loads(file.read()))
        os.wait()
    return found


def _do(work: dict[str, Any]) -> Deed:
    deed = Deed(work["what"], work["title"], os.getpid())
    path = Path(work["path"])
    _hesitate(np.random.default_rng(work["seed"]), path, deed)
    try:
        _WORKS[work["what"]](path, work, deed)
    except UserError as error:
        deed.error = str(error)
    except Exception as error:
        deed.error = f"unexpected {type(error).__name__}: {error}"
    return deed


def _hesitate(rng: np.random.Generator, path: Path, deed: Deed) -> None:
    """Wait by chance, now and before every call about files; note when one gets the path."""

    def hesitant(call: Callable[..., Any]) -> Callable[..., Any]:
        def later(*args: Any, **options: Any) -> Any:
            if rng.random() < 0.3:
                time.sleep(rng.exponential(0.003))
            done = call(*args, **options)
            if call.__name__ in ("link", "replace") and Path(args[1]) == path:
                deed.placed = time.monotonic()
            return done

        return later

    for name in ("open", "link", "replace", "close", "fsync", "fdatasync"):
        setattr(os, name, hesitant(getattr(os, name)))
    fcntl.fcntl = hesitant(fcntl.fcntl)
    time.sleep(rng.choice([0.0, 0.01, 0.1]) * rng.random())


def _run(path: Path, work: dict[str, Any], deed: Deed) -> None:
    force, progress = work["what"] == "run --force", Progress()
    with open_bench(small_setup(SHAPE)) as bench:
        plan = small_plan(work["title"])
        told = _noting(deed, work, progress)
        outcome = run_plan(
            bench, plan, path, Attendance(progress=progress, on_frame=told), force=force
        )
    deed.state = outcome.state
    deed.error = outcome.message


def _resume(path: Path, work: dict[str, Any], deed: Deed) -> None:
    progress = Progress()
    with open_bench(small_setup(SHAPE)) as bench:
        told = _noting(deed, work, progress)
        outcome = resume_run(bench, path, Attendance(progress=progress, on_frame=told))
    deed.state = outcome.state
    deed.error = outcome.message


def _noting(deed: Deed, work: dict[str, Any], progress: Progress) -> Callable[[Any, Any], None]:
    def told(shot: Any, frame: Any) -> None:
        deed.frames[str(shot.index)] = image_digest(np.ascontiguousarray(frame.image)).hex()
        deed.last = time.monotonic()
        deed.first = deed.first or deed.last
        if shot.index == work["stop"]:
            progress.cancel()

    return told


def _export(path: Path, work: dict[str, Any], deed: Deed) -> None:
    """Into the folder of the file, which has the name of an export's table."""
    export_frames(Path(work["other"]), "npy", path.parent, force=True)
    deed.state = "written"


def _write(path: Path, work: dict[str, Any], deed: Deed) -> None:
    require_writable(path, force=True)
    write_atomically(path, FOREIGN)
    deed.state = "written"


_WORKS = {
    "run": _run,
    "run --force": _run,
    "resume": _resume,
    "export --force": _export,
    "another --force": _write,
}

WORKS = tuple(_WORKS)

if __name__ == "__main__":
    _serve()
