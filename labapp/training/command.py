"""What all commands `labapp train ...` share: steps, the kept state, progress and messages."""

from __future__ import annotations

import copy
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from labapp.common.console import handle_stop_signals, out, terminal_progress
from labapp.common.errors import UserError
from labapp.files.state_file import StateFile
from labapp.training.loop import TrainingResult, run_training
from labapp.training.processes import Processes
from labapp.training.state import TrainingSchedule, TrainingState
from labapp.training.task import RememberingTask, TrainingTask
from optics.progress import Progress
from optics.threads import single_threaded


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


_TIMED_STEPS = 5
"""Steps whose time is measured, after one that isn't; their median counts. Chosen."""


@single_threaded
def count_steps(
    task: TrainingTask, schedule: TrainingSchedule, minutes: float, processes: Processes
) -> int:
    """Return how many steps fit into some minutes, validations included; at least 1.

    A few steps and a validation are timed; the task is as before afterwards. The number is the same
    in all processes. It depends on how busy the machine is then, and nothing makes the training end
    in time later.
    schedule: its number of steps is left out of account.
    """
    with _keep_unchanged(task):
        state = TrainingState(task, replace(schedule, steps=_TIMED_STEPS + 1), processes)
        times = [_time(state.take_step) for _ in range(_TIMED_STEPS + 1)][1:]
        validation = _time(state.validate)
    each = statistics.median(times) + validation / schedule.validation_interval
    return max(1, round(processes.take_from_writer(int(60 * minutes / each))))


@contextmanager
def _keep_unchanged(task: TrainingTask) -> Iterator[None]:
    """Undo all changes of a task's module and memory after the block."""
    weights = copy.deepcopy(task.module.state_dict())
    extra = copy.deepcopy(task.extra_state()) if isinstance(task, RememberingTask) else None
    try:
        yield
    finally:
        task.module.load_state_dict(weights)
        task.module.zero_grad(set_to_none=True)
        if isinstance(task, RememberingTask) and extra is not None:
            task.load_extra_state(extra)


def _time(work: Callable[[], object]) -> float:
    """Return the seconds that a call takes."""
    started = time.perf_counter()
    work()
    return time.perf_counter() - started
