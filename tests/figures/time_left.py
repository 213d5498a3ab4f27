"""The time left that the window tells of a run, against what was then left by the clock."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from small_bench.files import write_small

from drivers.errors import DeviceError
from figures import TOLD, Figure
from labapp.bench.opening import Bench, BenchFiles, open_bench
from labapp.files.plan_file import PlanFile
from labapp.runs.acquisition.attendance import AskOperator, Attendance
from labapp.runs.acquisition.feasibility import feasible_shots
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.state import State
from labapp.window.commands import AcquireBracket
from labapp.window.engine.frame_costs import FrameCosts
from labapp.window.engine.plan_building import build_bracket_plan
from labapp.window.engine.queued_run import QueuedRun
from labapp.window.engine.timing import RunTiming
from labapp.window.exposure_bracket import ExposureBracket
from optics.progress import Progress

_SHARE, _SECONDS = 0.2, 2.0
"""The goal: within this share of what is left, or these seconds."""

_FROM = 0.2
"""Share of a run's time from which on its time left is judged."""

_EVERY = 0.1
"""Seconds between two readings."""

_PATIENCE = 60.0
"""Seconds in which a served bench is ready."""

_RING = {"kind": "ring", "radius_um": 80.0, "width_um": 8.0, "wavelength_nm": 550.0}


def time_left_figures(folder: Path) -> list[Figure]:
    """The window's first bracket on the virtual bench, and one on a small bench behind its wires.

    Nothing is known of the first run of all. It is taken again in the session, and, on the virtual
    bench, in a new one, which has no pictures of it, but knows what they cost.
    """
    plan = _bracket(ExposureBracket(1, 8, 4), ExposureBracket(100, 4, 3))
    found: list[Figure] = []
    where = "virtual bench"
    for session in (("first of all", "again in the session"), ("again in a new session",)):
        with open_bench(BenchFiles.with_defaults()) as bench:
            found += _judge(folder, where, session, bench, plan, lambda text, progress: None)
    where, plan = "served bench", _bracket(ExposureBracket(8, 8, 3), ExposureBracket(100, 4, 3))
    try:
        with _served(folder / "served") as (files, ask), open_bench(files) as bench:
            session = ("first of all", "again in the session")
            return found + _judge(folder, where, session, bench, plan, ask)
    except (DeviceError, OSError, TimeoutError) as error:
        name, goal = _words(where, "again in the session")
        return [*found, Figure(name, goal, str(error), None)]


def _bracket(star: ExposureBracket, photograph: ExposureBracket) -> PlanFile:
    return build_bracket_plan(AcquireBracket(_RING, 550e-9, star, photograph, Path()))


def _words(where: str, which: str) -> tuple[str, str]:
    goal = f"within {100 * _SHARE:g} % or {_SECONDS:g} s from {100 * _FROM:g} % of the run on"
    return f"time left of a bracket on the {where}, {which}", goal


def _judge(
    folder: Path,
    where: str,
    session: tuple[str, ...],
    bench: Bench,
    plan: PlanFile,
    ask: AskOperator,
) -> list[Figure]:
    """Take the runs of a session, which share what they learn of costs."""
    costs = FrameCosts(folder / f"{where}.json", where)
    figures = []
    for which in session:
        readings, end = _take(folder / f"{where}, {which}.h5", bench, plan, costs, ask)
        wrong, told, lasted = _compare(readings, end)
        name, goal = _words(where, which)
        measured = f"{wrong:.1f} s off at worst, known at {told:.0f} % of readings; {lasted:.0f} s"
        # Of a first run, nothing like it was measured.
        first = which == "first of all"
        good = None if first else told == 100 and _is_good(readings, end)
        figures.append(Figure(name, TOLD if first else goal, measured, good))
    return figures


def _take(
    path: Path, bench: Bench, plan: PlanFile, costs: FrameCosts, ask: AskOperator
) -> tuple[list[tuple[float, float | None]], float]:
    """Take a run as the window's engine does. Readings: moment, seconds left; and its end."""
    shots = feasible_shots(plan, BenchCapabilities.of(bench), "bracket")
    timing = RunTiming(shots, virtual=not bench.file.is_real, costs=costs)
    run = QueuedRun(plan.title, path, run_plan, timing, planned_frames=len(shots), stored_frames=0)
    readings: list[tuple[float, float | None]] = []
    over = threading.Event()

    def read() -> None:
        while not over.wait(_EVERY):
            readings.append((time.monotonic(), run.info.seconds_left))

    def answer(text: str, progress: Progress) -> None:
        run.mark_paused(text)
        ask(text, progress)
        run.mark_resumed()

    run.mark_started()
    reader = threading.Thread(target=read)
    reader.start()
    outcome = run_plan(
        bench,
        plan,
        path,
        Attendance(progress=run.progress, ask=answer, on_frame=run.count_stored_frame),
    )
    end = time.monotonic()
    over.set()
    reader.join()
    if outcome.state is not State.COMPLETE:
        raise OSError(outcome.message)
    run.mark_ended(outcome.state, "")
    return readings, end


def _later(readings: list[tuple[float, float | None]], end: float) -> list[tuple[float, float]]:
    """What was told and what was true from `_FROM` of the run on; told is NaN where unknown."""
    begin = readings[0][0] - _EVERY
    return [
        (float("nan") if told is None else told, end - moment)
        for moment, told in readings
        if moment - begin >= _FROM * (end - begin)
    ]


def _compare(readings: list[tuple[float, float | None]], end: float) -> tuple[float, float, float]:
    """The largest error in seconds, percent of readings that told a time, and the run's seconds."""
    later = _later(readings, end)
    known = [(told, true) for told, true in later if told == told]
    worst = max((abs(told - true) for told, true in known), default=float("nan"))
    return worst, 100 * len(known) / len(later), end - readings[0][0]


def _is_good(readings: list[tuple[float, float | None]], end: float) -> bool:
    return all(
        abs(told - true) <= max(_SHARE * true, _SECONDS) for told, true in _later(readings, end)
    )


@contextmanager
def _served(folder: Path) -> Iterator[tuple[BenchFiles, AskOperator]]:
    """A small bench behind its wires: its bench file, and who places its targets when asked."""
    small = write_small(folder)
    out = folder / "served.toml"
    command = [sys.executable, "-m", "labapp", "virtual-bench", "serve", *small.arguments()]
    process = subprocess.Popen(
        [*command, "--out", str(out), "--until-eof"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    late = time.monotonic() + _PATIENCE
    try:
        while not out.exists():
            if process.poll() is not None or time.monotonic() > late:
                raise TimeoutError("the served bench was never ready; does it have Aravis?")
            time.sleep(0.2)
        yield BenchFiles(out, small.scene), partial(_place, process)
    finally:
        assert process.stdin is not None
        process.stdin.close()
        process.wait(_PATIENCE)


def _place(process: subprocess.Popen[str], text: str, progress: Progress) -> None:
    """Put the target that a run asks for before the camera."""
    assert process.stdin is not None
    for target in ("dark", "star", "photograph"):
        if target in text:
            process.stdin.write(f"target {target}\n")
            process.stdin.flush()
            time.sleep(0.5)
            return


MEASUREMENTS = {"time-left": time_left_figures}
