"""The queue of runs, which are taken in turn until one fails or is cancelled."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from labapp.runs.state import State
from labapp.window.engine.queued_run import QueuedRun
from labapp.window.messages import RunInfo

_NOT_WELL = {State.CANCELLED: "was cancelled", State.FAILED: "failed"}


class RunQueue:
    """Keep runs in their order; any thread may call the methods.

    After a run failed or was cancelled, the others are held: what stopped it may stop them too, and
    nobody may be there to see it. `hold_reason` tells why until release() is called. A run that is
    still being prepared is held as well, so its preparation begins with expect_run() and ends with
    add() or drop_expected(). `on_change` is called after each change.
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
        """Return whether a queued run writes this record now, or will write it."""
        with self._lock:
            return any(run.path == path and not run.state.has_ended for run in self._runs)

    @property
    def can_begin(self) -> bool:
        """Return whether begin() would return a run."""
        with self._lock:
            return not self.hold_reason and self._next() is not None

    def expect_run(self) -> None:
        """Announce that a run is being prepared."""
        with self._lock:
            self._expected += 1

    def hold(self, reason: str) -> None:
        """Begin no further run until release(), because of this reason."""
        with self._lock:
            self.hold_reason = reason
        self._on_change()

    def add(self, run: QueuedRun) -> None:
        with self._lock:
            unwanted = self._arrives()
            self._count += 1
            run.number, run.on_change = self._count, self._on_change
            self._runs.append(run)
            if unwanted:
                self._refuse(run)
            # A run that had ended before waits for nothing.
            self._let_go()
        self._on_change()

    def drop_expected(self) -> None:
        """Withdraw an announced run that couldn't be prepared."""
        with self._lock:
            self._arrives()
            self._let_go()
        self._on_change()

    def begin(self) -> QueuedRun | None:
        """Start the next run and return it; None if none may begin."""
        with self._lock:
            run = self._next()
            if run is None or self.hold_reason:
                return None
            run.mark_started()
        self._on_change()
        return run

    def end(self, run: QueuedRun, state: State, message: str, took: float = 0.0) -> None:
        """Note that a run has ended."""
        with self._lock:
            run.mark_ended(state, message, took)
            self._hold_after(run)
        self._on_change()

    def cancel(self) -> None:
        """Cancel the run under way, or the next if it is about to begin."""
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
        """Remove the runs of these numbers if they are waiting."""
        self._keep(lambda run: run.number not in numbers or run.state is not State.WAITING)

    def clear(self) -> None:
        """Remove the runs that have ended."""
        self._keep(lambda run: not run.state.has_ended)

    def release(self) -> None:
        """End the hold, so that the next run may begin."""
        with self._lock:
            self.hold_reason = ""
        self._on_change()

    def _keep(self, condition: Callable[[QueuedRun], bool]) -> None:
        with self._lock:
            self._runs = [run for run in self._runs if condition(run)]
            self._let_go()
        self._on_change()

    def _arrives(self) -> bool:
        """Count an announced run as arrived; return whether it was cancelled."""
        unwanted, self._expected_cancelled = self._expected_cancelled, False
        self._expected = max(0, self._expected - 1)
        return unwanted

    def _refuse(self, run: QueuedRun) -> None:
        run.mark_ended(State.CANCELLED, "cancelled before it began")
        self._hold_after(run)

    def _let_go(self) -> None:
        """End the hold if no run is waiting any more."""
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
