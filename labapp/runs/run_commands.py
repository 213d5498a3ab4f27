"""The commands `labapp run` and `labapp resume`: execute plan files on a bench, or resume a run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.interfaces import Frame
from labapp.bench.opening import Bench, BenchFiles, BenchSetup, open_bench
from labapp.common.console import out, print_error, print_json, print_message, terminal_progress
from labapp.common.errors import UserError, WaitedTooLong
from labapp.common.plain_text import shell_word
from labapp.files.fault_file import read_faults
from labapp.files.plan_file import NamedPlan, PlanFile
from labapp.files.plan_folder import PLAN_FILE, RECORD_FILE
from labapp.files.writing import make_folder
from labapp.runs.acquisition.attendance import AskOperator, Attendance
from labapp.runs.acquisition.runner import (
    RunOutcome,
    RunRequest,
    hold_record,
    resume_run,
    run_all,
    run_plan,
)
from labapp.runs.keyboard import open_keyboard
from labapp.runs.record.reader import Record, file_sha256
from labapp.runs.shots import Shot
from labapp.runs.state import State
from optics.progress import Cancelled, Progress


@dataclass(frozen=True)
class ExecutionOptions:
    """Options of the commands that execute plans.

    force: whether existing files may be replaced.
    yes: whether all prompts count as answered.
    speed: the virtual bench's time over real time.
    wait_limit: longest wait for a person, seconds; None depends on whether there is a terminal.
    """

    force: bool = False
    yes: bool = False
    speed: float = math.inf
    as_json: bool = False
    wait_limit: float | None = None


def run_files(
    plans: Sequence[NamedPlan],
    records: Sequence[Path],
    files: BenchFiles,
    execution: ExecutionOptions,
) -> None:
    """Execute plans in turn, each into its record, and print how each ended.

    Raises UserError if a run isn't COMPLETE, or Cancelled if it was cancelled.
    """
    if len(plans) > 1:
        make_folder(records[0].parent)
    requests = [
        RunRequest(one.plan, record, str(one.path), one.path.parent)
        for one, record in zip(plans, records, strict=True)
    ]

    def report(outcome: RunOutcome) -> None:
        # The error of a run that was alone is raised at the end.
        if len(plans) > 1 and (failure := _failure_of(outcome)) is not None:
            print_error(str(failure))
        _report_outcome(outcome, execution)

    with (
        open_bench(files, speed=execution.speed) as bench,
        attended_run(execution) as attendance,
    ):
        outcomes = run_all(
            bench,
            requests,
            attendance,
            force=execution.force,
            on_outcome=report,
        )
    if execution.as_json:
        data = [_as_data(outcome) for outcome in outcomes]
        print_json(data if len(plans) > 1 else data[0])
    failures = [found for one in outcomes if (found := _failure_of(one)) is not None]
    if failures and len(records) == 1:
        raise failures[0]
    if failures:
        unbegun = ", ".join(str(record) for record in records[len(outcomes) :])
        then = f"; not begun: {unbegun}. Run their plans again" if unbegun else ""
        raise type(failures[-1])(f"{len(failures)} of {len(records)} runs aren't COMPLETE{then}.")


def run_written_plan(
    bench: Bench,
    plan: PlanFile,
    folder: Path,
    *,
    force: bool,
    progress: Progress,
    ask: AskOperator | None,
) -> None:
    """Execute the plan that was written to a folder, with its record beside it.

    Raises UserError if the run isn't COMPLETE, or Cancelled if it was cancelled.
    """
    outcome = run_plan(
        bench,
        plan,
        folder / RECORD_FILE,
        Attendance(progress=progress, ask=ask),
        source=str(folder / PLAN_FILE),
        folder=folder,
        force=force,
    )
    require_complete(outcome)


def resume_file(
    record: Path, bench: Path | None, faults: Path | None, execution: ExecutionOptions
) -> None:
    """Take the frames that a record lacks, by default on the bench on which it was begun."""
    with ExitStack() as stack:
        with terminal_progress() as progress:
            held = stack.enter_context(hold_record(record, progress))
        with Record(record) as opened:
            setup = bench_setup_of(opened, faults)
        if bench is None:
            _confirm_recorded_bench(setup, record, execution)
        else:
            read = BenchFiles.with_defaults(bench).read()
            setup = replace(setup, bench=read.bench, source=read.source)
        if not execution.as_json:
            print_message(f"{record}: {len(held.missing)} frames to take")
        opened_bench = stack.enter_context(open_bench(setup, speed=execution.speed))
        attendance = stack.enter_context(attended_run(execution))
        outcome = resume_run(opened_bench, held, attendance)
    _report_outcome(outcome, execution)
    if execution.as_json:
        print_json(_as_data(outcome))
    require_complete(outcome)


def _confirm_recorded_bench(setup: BenchSetup, record: Path, execution: ExecutionOptions) -> None:
    """Show the real devices that a record names, and ask whether they may be opened.

    A record may come from somebody else. Raises UserError if nobody is there to answer.
    """
    devices = []
    for role, table in setup.bench.devices.run_devices.items():
        if table.is_exclusive:
            # By repr, they are on one line, without control characters.
            options = ", ".join(f"{name} = {value!r}" for name, value in table.options.items())
            devices.append(f"  {role}: {table.driver}" + (f" ({options})" if options else ""))
    if not devices or execution.yes:
        return
    print_message("\n".join((f"{record} opens these devices of this computer:", *devices)))
    with terminal_progress() as progress, open_keyboard(progress) as keyboard:
        if not keyboard.is_terminal:
            raise UserError(
                f"{record}: nobody is there to say whether its devices may be opened. Give the "
                "bench file by --bench, or --yes."
            )
        print_message("Enter opens them, Ctrl-C ends.")
        keyboard.wait_for_enter(progress)


def bench_setup_of(record: Record, faults: Path | None = None) -> BenchSetup:
    """Return the recorded bench setup; UserError if a picture of its scene has changed."""
    for file, known in record.scene_picture_digests.items():
        if file_sha256(Path(file)) != known:
            raise UserError(
                f"{record.path}: {file} is not the picture any more that the run was begun with. "
                "Put it back, or run the plan again."
            )
    return BenchSetup(
        record.bench_as_opened,
        record.scene,
        f"{record.path}: bench",
        f"{record.path}: scene",
        read_faults(faults) if faults else (),
    )


def require_complete(outcome: RunOutcome) -> None:
    """Raise Cancelled if a run was cancelled, and UserError if it isn't complete otherwise."""
    if (failure := _failure_of(outcome)) is not None:
        raise failure


def _failure_of(outcome: RunOutcome) -> Exception | None:
    """Return the error that tells why a run isn't COMPLETE, and how to go on; else None."""
    if outcome.state is State.CANCELLED:
        return Cancelled(f"{outcome.path}: CANCELLED, {len(outcome.missing)} frames not taken")
    if outcome.state is State.COMPLETE:
        return None
    listed = ", ".join(str(index) for index in outcome.missing[:8])
    more = ", ..." if len(outcome.missing) > 8 else ""
    lacks = f"{len(outcome.missing)} frames are missing ({listed}{more})"
    kind = WaitedTooLong if outcome.waited_too_long else UserError
    return kind(
        f"{outcome.path}: FAILED: {outcome.message}\n"
        f"{lacks if outcome.missing else 'Its frames are stored'}. Mend the cause, then: "
        f"labapp resume {shell_word(outcome.path)}"
    )


@contextmanager
def interactive_progress(execution: ExecutionOptions) -> Iterator[tuple[Progress, AskOperator]]:
    """Yield a progress that the terminal shows, and the function that asks prompts there."""
    with attended_run(execution) as attendance:
        assert attendance.ask is not None
        yield attendance.progress, attendance.ask


@contextmanager
def attended_run(execution: ExecutionOptions) -> Iterator[Attendance]:
    """Yield what the person at the terminal sees, and is asked.

    Nobody is asked about doubted frames where nobody is at a terminal, or all prompts count as
    answered: such a frame is kept, and the record's log has the doubt.
    """
    waiting = terminal_progress(execution.wait_limit)
    with waiting as progress, open_keyboard(progress) as keyboard:

        def ask(text: str, progress: Progress) -> None:
            print_message(text)
            if not execution.yes:
                keyboard.wait_for_enter(progress)

        def judge(doubt: str, shot: Shot, frame: Frame, progress: Progress) -> bool:
            print_message(f"{doubt} Enter takes the frame again, k keeps it.")
            return not keyboard.wait_for_enter(progress, other_key="k")

        judges = keyboard.is_terminal and not execution.yes
        yield Attendance(progress, ask, judge if judges else None)


def print_written_plan(
    plan: Path, patterns: int, record: Path, following: str, as_json: bool
) -> None:
    """Print that a plan was written for later, and the commands to come.

    patterns: number of its pattern files. record: file that the run will write. following: command
        after the run.
    """
    if as_json:
        print_json({"plan": str(plan), "patterns": patterns})
        return
    both = f" and {patterns} patterns" if patterns else ""
    lines = f"wrote {plan}{both}. Then:\nlabapp run {shell_word(plan)} --out {shell_word(record)}"
    # A command to copy isn't broken into lines.
    out.print(f"{lines}\n{following}", soft_wrap=True)


def _report_outcome(outcome: RunOutcome, execution: ExecutionOptions) -> None:
    if execution.as_json or outcome.state is not State.COMPLETE:
        return
    took = (
        f"{outcome.elapsed_seconds:.1f} s of bench time, {outcome.expected_seconds:.1f} s expected"
    )
    text = f"{outcome.path}: COMPLETE ({took}). See it with: labapp show {shell_word(outcome.path)}"
    out.print(text, soft_wrap=True)
    # Kept elsewhere, it shows later whether the record is still the one that the run left.
    out.print(f"digest {outcome.digest}", soft_wrap=True)
    if outcome.message:
        print_error(outcome.message)


def _as_data(outcome: RunOutcome) -> dict[str, object]:
    return {
        "record": str(outcome.path),
        "state": outcome.state,
        "missing": outcome.missing,
        "message": outcome.message,
        "expected_s": outcome.expected_seconds,
        "took_s": outcome.elapsed_seconds,
        "digest": outcome.digest,
    }
