"""Several runs, one after the other, checked together before the first begins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.writing import require_writable
from labapp.runs.acquisition.feasibility import estimate_run, feasible_shots
from labapp.runs.acquisition.frame_taker import AskOperator
from labapp.runs.acquisition.runner import RunOutcome, run_plan
from labapp.runs.bench_interface import Bench
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.state import State
from optics.progress import Progress


@dataclass(frozen=True)
class RunRequest:
    """A run that somebody wants: the plan, its name in errors and folder, and the record."""

    plan: PlanFile
    path: Path
    source: str = "plan"
    folder: Path = Path()


def run_all(
    bench: Bench,
    requests: Sequence[RunRequest],
    *,
    force: bool = False,
    progress: Progress | None = None,
    ask: AskOperator | None = None,
    on_outcome: Callable[[RunOutcome], None] = lambda outcome: None,
) -> list[RunOutcome]:
    """Run every request; see run_plan(). A run that fails doesn't keep the next from its turn.

    Cancelling ends the run under way and the queue. on_outcome: hears how each ended.
    UserError, before anything has moved, if one of them can't be run or two share a record.
    """
    progress = progress or Progress()
    seconds = _require_all(bench, requests, force)
    total = sum(seconds) or 1.0
    outcomes: list[RunOutcome] = []
    for number, request in enumerate(requests):
        part = progress.part(sum(seconds[:number]) / total, sum(seconds[: number + 1]) / total)
        outcome = run_plan(
            bench,
            request.plan,
            request.path,
            source=request.source,
            folder=request.folder,
            force=force,
            progress=part,
            ask=ask,
        )
        outcomes.append(outcome)
        on_outcome(outcome)
        if outcome.state is State.CANCELLED:
            break
    return outcomes


def _require_all(bench: Bench, requests: Sequence[RunRequest], force: bool) -> list[float]:
    """The seconds that each run is expected to take."""
    abilities = BenchCapabilities.of(bench)
    paths = [request.path.resolve() for request in requests]
    seconds = []
    for request, path in zip(requests, paths, strict=True):
        if paths.count(path) > 1:
            raise UserError(f"{request.path}: two runs would write it. Give each its own name.")
        listed = feasible_shots(request.plan, abilities, request.source)
        require_writable(request.path, force=force)
        seconds.append(estimate_run(listed, request.plan, abilities).seconds)
    return seconds
