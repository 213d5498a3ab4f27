"""`labapp run` and `labapp resume`: plan files on a bench, and what is left of one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from labapp.bench.opening import BenchFiles, BenchSetup, open_bench
from labapp.common.console import complain, out, print_json, say, watched
from labapp.common.errors import UserError
from labapp.files.fault_file import read_faults
from labapp.files.plan_file import NamedPlan
from labapp.files.writing import make_folder
from labapp.runs.acquisition.queue import Request, run_all
from labapp.runs.acquisition.runner import Outcome, resume_run
from labapp.runs.acquisition.taking import Ask
from labapp.runs.keyboard import listening
from labapp.runs.record.reader import Record, digest
from labapp.runs.state import State
from optics.progress import Cancelled, Progress


@dataclass(frozen=True)
class Manner:
    """How a person wants runs to be done.

    yes: prompts count as answered. speed: seconds of a virtual bench's time in a second.
    """

    force: bool = False
    yes: bool = False
    speed: float = math.inf
    as_json: bool = False


def run_files(
    plans: Sequence[NamedPlan], records: Sequence[Path], files: BenchFiles, manner: Manner
) -> None:
    """Run plans in turn, each into its record, and say how each ended; anything but COMPLETE is
    an error."""
    if len(plans) > 1:
        make_folder(records[0].parent)
    requests = [
        Request(one.plan, record, str(one.path), one.path.parent)
        for one, record in zip(plans, records, strict=True)
    ]
    with open_bench(files, speed=manner.speed) as bench, attended(manner) as (progress, ask):
        outcomes = run_all(
            bench,
            requests,
            force=manner.force,
            progress=progress,
            ask=ask,
            on_outcome=lambda outcome: _tell(outcome, manner),
        )
    if manner.as_json:
        data = [_as_data(outcome) for outcome in outcomes]
        print_json(data if len(plans) > 1 else data[0])
    # Of several troubles the first; all of them were told as they came.
    for outcome in outcomes:
        require_complete(outcome)


def resume_file(record: Path, bench: Path | None, faults: Path | None, manner: Manner) -> None:
    """Take the frames that a record lacks, on the bench that it was begun on."""
    with Record(record) as opened:
        setup = setup_of(opened, faults)
        missing = opened.missing()
    made_from = setup if bench is None else _with_bench(setup, bench)
    if not manner.as_json:
        say(f"{record}: {len(missing)} frames to take")
    with (
        open_bench(made_from, speed=manner.speed) as opened_bench,
        attended(manner) as (progress, ask),
    ):
        outcome = resume_run(opened_bench, record, missing=missing, progress=progress, ask=ask)
    _tell(outcome, manner)
    if manner.as_json:
        print_json(_as_data(outcome))
    require_complete(outcome)


def setup_of(record: Record, faults: Path | None = None) -> BenchSetup:
    """The bench that a record was taken on; UserError if a picture of its scene has changed."""
    for file, known in record.pictures.items():
        if digest(Path(file)) != known:
            raise UserError(
                f"{record.path}: {file} is not the picture any more that the run was begun with. "
                "Put it back, or run the plan again."
            )
    return BenchSetup(
        record.bench,
        record.scene,
        f"{record.path}: bench",
        f"{record.path}: scene",
        read_faults(faults) if faults else (),
    )


def require_complete(outcome: Outcome) -> None:
    """Cancelled if the user cancelled; UserError if frames are missing for another reason."""
    if outcome.state is State.CANCELLED:
        raise Cancelled(f"{outcome.path}: CANCELLED, {len(outcome.missing)} frames not taken")
    if outcome.state is not State.COMPLETE:
        listed = ", ".join(str(index) for index in outcome.missing[:8])
        raise UserError(
            f"{outcome.path}: FAILED: {outcome.message}\n"
            f"{len(outcome.missing)} frames are missing ({listed}"
            f"{', ...' if len(outcome.missing) > 8 else ''}). Mend the cause, then: "
            f"labapp resume {outcome.path}"
        )


@contextmanager
def attended(manner: Manner) -> Iterator[tuple[Progress, Ask]]:
    """A progress with a keyboard beside it, and somebody who answers prompts."""
    with watched() as progress, listening(progress) as keyboard:

        def ask(text: str, progress: Progress) -> None:
            say(text)
            if not manner.yes:
                keyboard.wait_for_enter(progress)

        yield progress, ask


def _with_bench(setup: BenchSetup, bench: Path) -> BenchSetup:
    read = BenchFiles.default(bench).read()
    return replace(setup, bench=read.bench, source=read.source)


def _tell(outcome: Outcome, manner: Manner) -> None:
    if manner.as_json or outcome.state is not State.COMPLETE:
        return
    took = f"{outcome.took:.1f} s of bench time, {outcome.expected:.1f} s expected"
    text = f"{outcome.path}: COMPLETE ({took}). See it with: labapp show {outcome.path}"
    out.print(text, markup=False, soft_wrap=True)
    if outcome.message:
        complain(outcome.message)


def _as_data(outcome: Outcome) -> dict[str, object]:
    return {
        "record": str(outcome.path),
        "state": outcome.state,
        "missing": outcome.missing,
        "message": outcome.message,
        "expected_s": outcome.expected,
        "took_s": outcome.took,
    }
