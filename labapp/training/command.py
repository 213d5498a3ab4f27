"""What all commands `labapp train ...` share: steps, the kept state, progress and messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from labapp.common.console import handle_stop_signals, out, terminal_progress
from labapp.common.errors import UserError
from labapp.files.state_file import StateFile
from labapp.training.loop import TrainingResult, run_training
from labapp.training.processes import Processes
from labapp.training.schedule import TrainingSchedule
from labapp.training.step_count import count_steps
from labapp.training.task import TrainingTask
from optics.progress import Progress


def train_for_command(
    task: TrainingTask,
    schedule: TrainingSchedule,
    path: Path,
    processes: Processes,
    *,
    steps: int | None = None,
    minutes: float | None = None,
) -> TrainingResult:
    """Train a task, and print how many steps there are and where the state is kept.

    Ctrl-C, SIGTERM and a closed terminal end the training after the running step, and the state is
    kept. The caller deletes its file when the result is written. Raises UserError if the kept state
    can't be used or written, or the training fails.
    schedule: its steps count where neither `steps` nor `minutes` is given.
    path: file of the state.
    processes: share the samples; the first one prints.
    steps: in all.
    minutes: time of which the number of steps is made, unless a kept state has one already.
    """
    kept = StateFile(path, "training")
    before = kept.read_steps()
    count = steps or before
    if count is None and minutes is not None:
        count = count_steps(task, schedule, minutes, processes)
    schedule = replace(schedule, steps=count or schedule.steps)
    if processes.is_writer:
        going_on = "" if before is None else ", going on from the state"
        out.print(f"{schedule.steps} steps{going_on}; kept so far in {path}")
    with show_progress(processes) as progress:
        try:
            result = run_training(task, schedule, kept, processes, progress)
        except FloatingPointError as error:
            raise UserError(str(error)) from error
    if processes.is_writer and result.skipped:
        out.print(f"{result.skipped} steps had no finite loss and gradient and were skipped")
    return result


@contextmanager
def show_progress(processes: Processes) -> Iterator[Progress]:
    """Show progress in the terminal, once for all processes; signals cancel it."""
    if processes.is_writer:
        with terminal_progress() as progress:
            yield progress
        return
    progress = Progress()
    with handle_stop_signals(lambda number, frame: progress.cancel()):
        yield progress
