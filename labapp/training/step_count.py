"""Find how many steps fit into the time that a person gives a training."""

from __future__ import annotations

import copy
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from labapp.training.processes import Processes
from labapp.training.schedule import TrainingSchedule
from labapp.training.state import TrainingState
from labapp.training.task import RememberingTask, TrainingTask
from optics.threads import single_threaded

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
