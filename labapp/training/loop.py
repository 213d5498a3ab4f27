"""The one loop that trains every task.

Each step lowers the mean loss of its samples by Adam; the result is the running mean of the
weights. All random numbers of a step follow from the seed, the step and the sample, so that a
training that was interrupted ends in the same weights as one that wasn't, bit for bit where as many
processes with one thread each run on the same kind of machine.

Sources: D. P. Kingma and J. Ba, Adam, arXiv 1412.6980, 2015; for the mean of the weights,
B. T. Polyak and A. B. Juditsky, SIAM J. Control Optim. 30, 838, 1992, doi 10.1137/0330046.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import torch

from labapp.files.state_file import StateFile
from labapp.training.processes import Processes
from labapp.training.state import TrainingSchedule, TrainingState
from labapp.training.task import TrainingTask
from optics.progress import Cancelled, Progress
from optics.threads import single_threaded

MOST_FAILURES = 5
"""Steps in a row without a finite loss and gradient after which the loop halts; chosen."""


@dataclass(frozen=True, eq=False)
class TrainingResult:
    """The averaged weights, and how they were reached.

    weights: running mean of the weights after the last step, by their names in the module.
    history: step and score of each validation; the last one is of `weights`.
    steps: in all, those that were skipped included.
    skipped: steps that were skipped because loss or gradient weren't finite.
    work: samples that each process computed, since the training was started or continued.
    """

    weights: dict[str, torch.Tensor]
    history: tuple[tuple[int, float], ...]
    steps: int
    skipped: int
    work: tuple[int, ...]


@single_threaded
def run_training(
    task: TrainingTask,
    schedule: TrainingSchedule,
    kept: StateFile | None = None,
    processes: Processes | None = None,
    progress: Progress | None = None,
) -> TrainingResult:
    """Train a task to the end of its schedule, and return the averaged weights.

    The task's module holds the last weights afterwards. Raises UserError if the kept state is
    damaged, is of other settings, or can't be written; ValueError if the task doesn't fit the
    processes or the precision of the loop, or its settings and the schedule contradict each other;
    FloatingPointError if `MOST_FAILURES` steps in a row have no finite loss and gradient; Cancelled
    if progress, in any of the processes, asked for it.
    kept: file of the state. Training goes on from it if it is there, and writes it at each
    validation, when it was last written `labapp.files.state_file.WRITE_INTERVAL` seconds ago,
    and when the training is cancelled. It stays when the training ends.
    processes: share the samples; this one alone by default.
    progress: receives a report of every step, and can cancel after one.
    """
    processes, progress = processes or Processes(), progress or Progress()
    settings = describe_training(task, schedule)
    state = TrainingState(task, schedule, processes)
    stored = None if kept is None else kept.read(settings)
    if kept is not None and stored is not None:
        try:
            state.load_data(stored)
        except (LookupError, RuntimeError, TypeError, ValueError) as error:
            raise kept.describe_damage(error) from error

    def keep() -> None:
        if kept is not None and processes.is_writer:
            kept.write(settings, state.as_data())

    with _flush_denormals():
        while True:
            reached = state.step == schedule.steps or (
                state.step > 0 and state.step % schedule.validation_interval == 0
            )
            if reached and (not state.history or state.history[-1][0] < state.step):
                state.validate()
                keep()
            if state.step >= schedule.steps:
                break
            loss = state.take_step()
            if state.failures >= MOST_FAILURES:
                raise FloatingPointError(
                    f"steps {state.step - state.failures + 1} to {state.step} of the training had "
                    f"no finite loss and gradient ({state.skipped} such steps in all). Lower the "
                    "learning rate, or look for numbers in the data that aren't finite. The state "
                    "that was kept before is as it was."
                )
            stop = not _report(progress, state, schedule, loss)
            if processes.agree(stop):
                keep()
                raise Cancelled("cancelled")
            if kept is not None and kept.is_due():
                keep()
    own_work = torch.tensor([state.samples_computed], device=processes.device)
    work = tuple(processes.gather(own_work).tolist())
    return TrainingResult(state.average, tuple(state.history), state.step, state.skipped, work)


def describe_training(task: TrainingTask, schedule: TrainingSchedule) -> dict[str, Any]:
    """Return everything that the result depends on, as plain data.

    Raises ValueError if a setting of the task contradicts the schedule's of the same name.
    """
    scheduled = asdict(schedule)
    for name, value in task.settings.items():
        if name in scheduled and scheduled[name] != value:
            raise ValueError(
                f"{name} is {value} in the task's settings and {scheduled[name]} in the schedule; "
                "make them the same, or name the task's setting otherwise"
            )
    return {**scheduled, **task.settings}


def _report(
    progress: Progress, state: TrainingState, schedule: TrainingSchedule, loss: float
) -> bool:
    """Report a step, and return whether the loop may go on.

    Whether to stop is only returned, because all processes have to stop after the same step.
    """
    message = f"step {state.step}/{schedule.steps}, loss {loss:.4g}"
    if state.history:
        message += f", validation {state.history[-1][1]:.2f}"
    if state.skipped:
        message += f", {state.skipped} skipped"
    try:
        progress.report(state.step / schedule.steps, message)
    except Cancelled:
        return False
    return True


@contextmanager
def _flush_denormals() -> Iterator[None]:
    """Round denormal numbers to 0 while a network is trained; they slow processors.

    Other code in the process needs denormal numbers: without them SciPy's KDTree recurses forever.
    """
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
