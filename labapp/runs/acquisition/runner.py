"""Run plans on a bench, one or several in turn, or resume a run."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from math import prod
from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.common.stopwatch import Stopwatch
from labapp.files.plan_file import PlanFile
from labapp.files.write_locks import close_locked, duplicate_locked
from labapp.files.writing import require_writable
from labapp.runs.acquisition.active_run import ActiveRun, RunOutcome
from labapp.runs.acquisition.attendance import AskOperator, Attendance
from labapp.runs.acquisition.feasibility import estimate_run, expected_plan, feasible_shots
from labapp.runs.acquisition.frame_delays import measure_frame_delays
from labapp.runs.acquisition.frame_storage import require_space
from labapp.runs.acquisition.hooks import Hooks
from labapp.runs.acquisition.record_contents import build_record_contents
from labapp.runs.bench_interface import Bench
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.readouts import largest_shape
from labapp.runs.record.creation import create_record
from labapp.runs.record.reader import Record
from labapp.runs.record.writer_process import open_for_writing
from labapp.runs.shots import ShotList
from labapp.runs.state import State
from labapp.runs.steps import schedule_shots
from optics.progress import Progress

__all__ = [
    "Attendance",
    "HeldRecord",
    "RunOutcome",
    "RunRequest",
    "hold_record",
    "resume_run",
    "run_all",
    "run_plan",
]

log = logging.getLogger(__name__)


def run_plan(
    bench: Bench,
    plan: PlanFile,
    path: Path,
    attendance: Attendance | None = None,
    *,
    source: str = "plan",
    folder: Path = Path(),
    force: bool = False,
    stopwatch: Stopwatch | None = None,
) -> RunOutcome:
    """Run a plan: take all of its frames into a record, and leave the bench safe.

    The run ends with the state CANCELLED if the progress is cancelled, and with FAILED if a device
    fails as often as the plan allows, or the disk fails. A full disk pauses the run.

    Parameters
    ----------
    bench : Bench
        The open devices.
    plan : PlanFile
        Targets, patterns, wavelengths and exposures to be acquired.
    path : Path
        File of the record.
    attendance : Attendance, optional
        What the run tells the person or program that attends it, asks of them, and lets them do.
    source : str
        Name of the plan in errors.
    folder : Path
        Folder of the plan's picture files.
    force : bool
        Whether an existing record may be replaced.
    stopwatch : Stopwatch, optional
        Is told how long the stages of the run took.

    Returns
    -------
    RunOutcome
        The state in which the run ended, and the frames that are missing.

    Raises
    ------
    UserError
        If the plan can't be run at all; then nothing was moved or written.
    """
    attendance, stopwatch = attendance or Attendance(), stopwatch or Stopwatch()
    progress = attendance.progress
    abilities = BenchCapabilities.of(bench)
    # The exposures of brackets are settled later; in the brightest light they are shortest.
    possible = expected_plan(plan, abilities, bench.description.sensor, source)
    listed = feasible_shots(possible, abilities, source)
    expected = estimate_run(listed, possible, abilities)
    require_writable(path, force=force)
    require_space(path, expected.disk_bytes)
    _require_person(attendance.ask, expected.prompts)
    from labapp.patterns.grey_levels import compute_patterns

    hooks = Hooks.of(plan, bench)
    # Computing the patterns has 30 % of the run's progress; the frames have the rest.
    with stopwatch.stage("compute patterns"):
        part = progress.part(0, 0.3)
        patterns = compute_patterns(plan.patterns, bench.description, plan.seed, part, folder)
    with stopwatch.stage("measure delays"):
        abilities = measure_frame_delays(bench, abilities, listed, progress, patterns)
        listed = schedule_shots(listed, abilities)
    if plan.has_brackets:
        from labapp.runs.acquisition.bracket_metering import BracketMetering

        with stopwatch.stage("meter"):
            metering = replace(attendance, progress=progress.part(0.3, 0.3))
            plan = BracketMetering(bench, plan, patterns, metering, source, hooks).settle()
        listed = feasible_shots(plan, abilities, source)
        require_space(path, estimate_run(listed, plan, abilities).disk_bytes)
    if attendance.on_planned is not None:
        attendance.on_planned(listed)
    with stopwatch.stage("acquire"):
        acquiring = replace(attendance, progress=progress.part(0.3, 1))
        contents = build_record_contents(
            bench, plan, patterns, listed, abilities, progress.raise_if_cancelled
        )
        lock = create_record(path, contents, force=force)
        return ActiveRun(bench, plan, path, patterns, hooks, acquiring, lock).take(listed)


@dataclass(frozen=True)
class HeldRecord:
    """A record that is locked, so that nobody else resumes or replaces it.

    missing: indices of the frames to be taken. lock: handle that holds the lock. is_in_order:
    whether the record passes all checks already.
    """

    path: Path
    missing: list[int]
    lock: int
    is_in_order: bool


@contextmanager
def hold_record(path: Path, progress: Progress | None = None) -> Iterator[HeldRecord]:
    """Lock a run's record to resume it, repair what follows from the rest of it, and verify it.

    The frames to be taken are those that were never stored or are damaged. Raises UserError if the
    record is being written, is of an older format, or is damaged where taking frames again doesn't
    mend it.
    """
    lock = open_for_writing(path)
    try:
        # Imported here, because a new run needs neither.
        from labapp.runs.record.repair import repair_record
        from labapp.runs.verifying import verify

        for done in repair_record(path, lock):
            log.warning("%s: %s", path, done)
        found = verify(path, progress)
        if found.resume_command is None and not found.is_in_order:
            remedy = (
                "Wait for its run to end."
                if found.is_being_written
                else f"Save its frames with: labapp salvage {shell_word(path)} --out FILE"
            )
            raise UserError(f"{path}: can't be resumed: {found.reason}. {remedy}")
        missing = [] if found.is_in_order else sorted(found.not_stored + found.damaged)
        yield HeldRecord(path, missing, lock, found.is_in_order)
    finally:
        close_locked(lock)


def resume_run(
    bench: Bench, record: Path | HeldRecord, attendance: Attendance | None = None
) -> RunOutcome:
    """Resume a run: take the frames that its record lacks, with its own plan, patterns and seed.

    A frame that doesn't read back as it was stored is taken again. A record that is whole isn't
    changed.

    Parameters
    ----------
    bench : Bench
        The open devices, the same as when the run began.
    record : Path or HeldRecord
        File of the record, or the record that hold_record() has verified.
    attendance : Attendance, optional
        What the run tells the person or program that attends it, asks of them, and lets them do.

    Returns
    -------
    RunOutcome
        The state in which the run ended, and the frames that are missing.

    Raises
    ------
    UserError
        If the bench isn't the one that the run began on, or the record is still being written, or
        damaged where resuming can't mend it.
    """
    if isinstance(record, Path):
        with hold_record(record) as held:
            return resume_run(bench, held, attendance)
    attendance = attendance or Attendance()
    path, missing = record.path, record.missing
    abilities = BenchCapabilities.of(bench)
    with Record(path) as opened:
        plan = opened.plan
        patterns = opened.patterns()
        listed = feasible_shots(plan, abilities, str(path))
        _require_same_bench(opened, bench, listed)
        if record.is_in_order and opened.state is State.COMPLETE:
            digest = opened.closing_digest
            return RunOutcome(path, State.COMPLETE, [], opened.message, digest=digest)
    if missing:
        abilities = measure_frame_delays(bench, abilities, listed, attendance.progress, patterns)
        listed = schedule_shots(listed, abilities)
    left = listed.pick(missing)
    require_space(path, 2 * len(left) * prod(largest_shape(listed.readouts, abilities.frame_shape)))
    _require_person(attendance.ask, estimate_run(left, plan, abilities).prompts)
    hooks = Hooks.of(plan, bench)
    # Both handles are of the same open file, which has the lock.
    lock = duplicate_locked(record.lock)
    run = ActiveRun(bench, plan, path, patterns, hooks, attendance, lock)
    return run.take(left, is_resumed=True)


def _require_person(ask: AskOperator | None, prompts: Sequence[str]) -> None:
    if prompts and ask is None:
        raise UserError(
            f"the plan asks a person {len(prompts)} times, first: {prompts[0]!r}. "
            "Run it where somebody answers, or say that all is in place (--yes)."
        )


def _require_same_bench(record: Record, bench: Bench, listed: ShotList) -> None:
    """Raise UserError if the bench isn't the one on which the run of a record began."""
    for name, device in record.devices.items():
        identity = asdict(bench.devices[name].identity)
        if identity != device:
            raise UserError(
                f"{record.path}: was begun with the {name} {device['model']} "
                f"{device['serial']}, and this bench has {identity['model']} "
                f"{identity['serial']}. Resume it on the bench that it was begun on."
            )
    same = (
        np.array_equal(listed.column("exposure"), record.column("exposure_asked"))
        and np.array_equal(listed.column("step"), record.column("step"))
        and largest_shape(listed.readouts, bench.camera.shape) == record.frame_shape
        and bench.file == record.bench_as_opened
    )
    if not same:
        raise UserError(
            f"{record.path}: this bench differs from the one that the run was begun on. "
            "Leave --bench out to resume it on its own."
        )


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
    # All of them are checked before the first begins.
    abilities, sensor = BenchCapabilities.of(bench), bench.description.sensor
    paths = [request.path.resolve() for request in requests]
    seconds = []
    for request, path in zip(requests, paths, strict=True):
        if paths.count(path) > 1:
            raise UserError(f"{request.path}: two runs would write it. Give each its own name.")
        possible = expected_plan(request.plan, abilities, sensor, request.source)
        listed = feasible_shots(possible, abilities, request.source)
        require_writable(request.path, force=force)
        seconds.append(estimate_run(listed, possible, abilities).seconds)
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
