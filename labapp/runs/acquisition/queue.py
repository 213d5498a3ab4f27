"""Take several runs in turn, after all of them have been checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.writing import require_writable
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.feasibility import estimate_run, expected_plan, feasible_shots
from labapp.runs.acquisition.runner import RunOutcome, run_plan
from labapp.runs.bench_interface import Bench
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.state import State


@dataclass(frozen=True)
class RunRequest:
    """What to execute: plan, path of the record, the plan's name in errors, and its folder."""

    plan: PlanFile
    path: Path
    source: str = "plan"
    folder: Path = Path()


def run_all(
    bench: Bench,
    requests: Sequence[RunRequest],
    attendance: Attendance | None = None,
    *,
    force: bool = False,
    on_outcome: Callable[[RunOutcome], None] = lambda outcome: None,
) -> list[RunOutcome]:
    """Execute several plans in turn; the next begins even if one fails.

    Each is executed by run_plan(). Cancelling ends the present run and the queue, and so does a
    wait that nobody has ended in time. Raises UserError, before anything has moved, if one of the
    plans can't be executed, or two share a record.

    on_outcome: called with the outcome of each run.
    """
    attendance = attendance or Attendance()
    progress = attendance.progress
    seconds = _require_all(bench, requests, force)
    total = sum(seconds) or 1.0
    outcomes: list[RunOutcome] = []
    for number, request in enumerate(requests):
        part = progress.part(sum(seconds[:number]) / total, sum(seconds[: number + 1]) / total)
        outcome = run_plan(
            bench,
            request.plan,
            request.path,
            replace(attendance, progress=part),
            source=request.source,
            folder=request.folder,
            force=force,
        )
        outcomes.append(outcome)
        on_outcome(outcome)
        if outcome.state is State.CANCELLED or outcome.waited_too_long:
            break
    return outcomes


def _require_all(bench: Bench, requests: Sequence[RunRequest], force: bool) -> list[float]:
    """Check all requests; return the expected seconds of each."""
    abilities = BenchCapabilities.of(bench)
    paths = [request.path.resolve() for request in requests]
    seconds = []
    for request, path in zip(requests, paths, strict=True):
        if paths.count(path) > 1:
            raise UserError(f"{request.path}: two runs would write it. Give each its own name.")
        sensor = bench.description.sensor
        possible = expected_plan(request.plan, abilities, sensor, request.source)
        listed = feasible_shots(possible, abilities, request.source)
        require_writable(request.path, force=force)
        seconds.append(estimate_run(listed, possible, abilities).seconds)
    return seconds
