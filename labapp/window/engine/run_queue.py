"""Runs in line: one after the other, until one doesn't end well."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from labapp.runs.state import State
from labapp.window.engine.run import Run
from labapp.window.messages import RunInfo

_NOT_WELL = {State.CANCELLED: "was cancelled", State.FAILED: "failed"}


class RunQueue:
    """Every method may be called from any thread; `changed` is called after each change.

    After a run that was cancelled or failed the others wait: what stopped it may stop them,
    and nobody may be there to see it. `held` says so until somebody says go_on(). That holds
    for a run, too, that was asked for before and still is being made ready: who makes one says
    expect() first, and add() or dismiss() then.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._lock = threading.Lock()
        self._runs: list[Run] = []
        self._count = self._expected = 0
        self._unwanted = False
        self.held = ""

    def infos(self) -> tuple[RunInfo, ...]:
        with self._lock:
            return tuple(run.info for run in self._runs)

    def has(self, path: Path) -> bool:
        """Whether a run that hasn't ended writes, or will write, this file."""
        with self._lock:
            return any(run.path == path and not run.state.has_ended for run in self._runs)

    @property
    def may_go_on(self) -> bool:
        """Whether begin() would give a run."""
        with self._lock:
            return not self.held and self._next() is not None

    def expect(self) -> None:
        """A run was asked for, and will be there soon."""
        with self._lock:
            self._expected += 1

    def add(self, run: Run) -> None:
        with self._lock:
            unwanted = self._arrives()
            self._count += 1
            run.number, run.changed = self._count, self._changed
            self._runs.append(run)
            if unwanted:
                self._refuse(run)
        self._changed()

    def dismiss(self) -> None:
        """There won't be a run that was expected."""
        with self._lock:
            self._arrives()
            self._let_go()
        self._changed()

    def begin(self) -> Run | None:
        """The next run, under way from now on; None if none may begin."""
        with self._lock:
            run = self._next()
            if run is None or self.held:
                return None
            run.begin()
        self._changed()
        return run

    def end(self, run: Run, state: State, message: str, took: float = 0.0) -> None:
        with self._lock:
            run.end(state, message, took)
            self._hold_after(run)
        self._changed()

    def cancel(self) -> None:
        """Stop the run under way, or the one that is about to begin."""
        with self._lock:
            run = self._under_way()
            if run is not None:
                run.progress.cancel()
            elif not self.held and (run := self._next()) is not None:
                self._refuse(run)
            elif not self.held:
                self._unwanted = self._expected > 0
        self._changed()

    def pause(self, on: bool) -> None:
        with self._lock:
            run = self._under_way()
        if run is not None:
            run.pause(on)

    def remove(self, numbers: Sequence[int]) -> None:
        """Take runs that wait out of the line; others stay."""
        self._keep(lambda run: run.number not in numbers or run.state is not State.WAITING)

    def clear(self) -> None:
        """Forget the runs that have ended."""
        self._keep(lambda run: not run.state.has_ended)

    def go_on(self) -> None:
        with self._lock:
            self.held = ""
        self._changed()

    def _keep(self, wanted: Callable[[Run], bool]) -> None:
        with self._lock:
            self._runs = [run for run in self._runs if wanted(run)]
            self._let_go()
        self._changed()

    def _arrives(self) -> bool:
        """One that was expected; whether it was cancelled before it was there."""
        unwanted, self._unwanted = self._unwanted, False
        self._expected = max(0, self._expected - 1)
        return unwanted

    def _refuse(self, run: Run) -> None:
        run.end(State.CANCELLED, "cancelled before it began")
        self._hold_after(run)

    def _let_go(self) -> None:
        """Hold nobody, where nobody is left to be held."""
        if not self._anybody_waits():
            self.held = ""

    def _anybody_waits(self) -> bool:
        return self._next() is not None or self._expected > 0

    def _under_way(self) -> Run | None:
        return next((run for run in self._runs if run.state.is_under_way), None)

    def _next(self) -> Run | None:
        return next((run for run in self._runs if run.state is State.WAITING), None)

    def _hold_after(self, run: Run) -> None:
        if run.state in _NOT_WELL and self._anybody_waits():
            self.held = f"{run.title} {_NOT_WELL[run.state]}"
