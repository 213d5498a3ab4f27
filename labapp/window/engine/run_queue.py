"""Runs in line: one after the other, until one doesn't end well."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from labapp.runs.state import State
from labapp.window.engine.queued_run import QueuedRun
from labapp.window.messages import RunInfo

_NOT_WELL = {State.CANCELLED: "was cancelled", State.FAILED: "failed"}


class RunQueue:
    """Every method may be called from any thread; `on_change` is called after each change.

    After a run that was cancelled or failed the others wait: what stopped it may stop them,
    and nobody may be there to see it. `hold_reason` says so until somebody calls release(). That
    holds for a run, too, that was asked for before and still is being made ready: who makes one
    calls expect_run() first, and add() or drop_expected() then.
    """

    def __init__(self, on_change: Callable[[], None]) -> None:
        self._on_change = on_change
        self._lock = threading.Lock()
        self._runs: list[QueuedRun] = []
        self._count = self._expected = 0
        self._expected_cancelled = False
        self.hold_reason = ""

    def run_infos(self) -> tuple[RunInfo, ...]:
        with self._lock:
            return tuple(run.info for run in self._runs)

    def has_record(self, path: Path) -> bool:
        """Whether a run that hasn't ended writes, or will write, this file."""
        with self._lock:
            return any(run.path == path and not run.state.has_ended for run in self._runs)

    @property
    def can_begin(self) -> bool:
        """Whether begin() would give a run."""
        with self._lock:
            return not self.hold_reason and self._next() is not None

    def expect_run(self) -> None:
        """A run was asked for, and will be there soon."""
        with self._lock:
            self._expected += 1

    def add(self, run: QueuedRun) -> None:
        with self._lock:
            unwanted = self._arrives()
            self._count += 1
            run.number, run.on_change = self._count, self._on_change
            self._runs.append(run)
            if unwanted:
                self._refuse(run)
        self._on_change()

    def drop_expected(self) -> None:
        """There won't be a run that was expected."""
        with self._lock:
            self._arrives()
            self._let_go()
        self._on_change()

    def begin(self) -> QueuedRun | None:
        """The next run, under way from now on; None if none may begin."""
        with self._lock:
            run = self._next()
            if run is None or self.hold_reason:
                return None
            run.mark_started()
        self._on_change()
        return run

    def end(self, run: QueuedRun, state: State, message: str, took: float = 0.0) -> None:
        with self._lock:
            run.mark_ended(state, message, took)
            self._hold_after(run)
        self._on_change()

    def cancel(self) -> None:
        """Stop the run under way, or the one that is about to begin."""
        with self._lock:
            run = self._under_way()
            if run is not None:
                run.progress.cancel()
            elif not self.hold_reason and (run := self._next()) is not None:
                self._refuse(run)
            elif not self.hold_reason:
                self._expected_cancelled = self._expected > 0
        self._on_change()

    def pause(self, on: bool) -> None:
        with self._lock:
            run = self._under_way()
        if run is not None:
            run.set_paused(on)

    def remove(self, numbers: Sequence[int]) -> None:
        """Take runs that wait out of the line; others stay."""
        self._keep(lambda run: run.number not in numbers or run.state is not State.WAITING)

    def clear(self) -> None:
        """Forget the runs that have ended."""
        self._keep(lambda run: not run.state.has_ended)

    def release(self) -> None:
        with self._lock:
            self.hold_reason = ""
        self._on_change()

    def _keep(self, condition: Callable[[QueuedRun], bool]) -> None:
        with self._lock:
            self._runs = [run for run in self._runs if condition(run)]
            self._let_go()
        self._on_change()

    def _arrives(self) -> bool:
        """One that was expected; whether it was cancelled before it was there."""
        unwanted, self._expected_cancelled = self._expected_cancelled, False
        self._expected = max(0, self._expected - 1)
        return unwanted

    def _refuse(self, run: QueuedRun) -> None:
        run.mark_ended(State.CANCELLED, "cancelled before it began")
        self._hold_after(run)

    def _let_go(self) -> None:
        """Hold nobody, where nobody is left to be held."""
        if not self._has_waiting():
            self.hold_reason = ""

    def _has_waiting(self) -> bool:
        return self._next() is not None or self._expected > 0

    def _under_way(self) -> QueuedRun | None:
        return next((run for run in self._runs if run.state.is_under_way), None)

    def _next(self) -> QueuedRun | None:
        return next((run for run in self._runs if run.state is State.WAITING), None)

    def _hold_after(self, run: QueuedRun) -> None:
        if run.state in _NOT_WELL and self._has_waiting():
            self.hold_reason = f"{run.title} {_NOT_WELL[run.state]}"
