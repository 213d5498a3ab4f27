"""Preparation of runs: read, check and name them, then queue them."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from labapp.bench.opening import Bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.files.writing import make_folder
from labapp.runs.acquisition.feasibility import expected_plan, feasible_shots
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.record.reader import Record
from labapp.runs.shots import Shot
from labapp.runs.state import State
from labapp.window.commands import (
    AcquireBracket,
    KeptRequest,
    RestoreQueue,
    ResumeRun,
    RunPlan,
    RunRequest,
)
from labapp.window.engine.frame_costs import FrameCosts, cost_file
from labapp.window.engine.plan_building import build_bracket_plan
from labapp.window.engine.queued_run import QueuedRun
from labapp.window.engine.run_queue import RunQueue
from labapp.window.engine.timing import RunTiming

log = logging.getLogger(__name__)


class RunPlanner:
    """Prepare and queue runs in a thread of its own, so that a slow disk delays nothing else.

    A run that the bench can't do is refused when it is requested, not hours later. The bench is
    asked once what it can do, because its devices are busy during a run. `on_failure` is called
    with the request and the error that kept its run from being queued, and `on_ready` after a run
    was queued.
    """

    def __init__(
        self,
        bench: Bench,
        queue: RunQueue,
        *,
        on_failure: Callable[[RunRequest, Exception], None],
        on_ready: Callable[[], None],
    ) -> None:
        self._bench, self._queue, self._on_failure, self._on_ready = (
            bench,
            queue,
            on_failure,
            on_ready,
        )
        self._abilities = BenchCapabilities.of(bench)
        rows, columns = self._abilities.frame_shape
        self._costs = FrameCosts(cost_file(), f"{bench.file.name}, {columns} x {rows} pixels")
        self._thread = ThreadPoolExecutor(1, "planner")
        self._make: dict[type, Callable[[Any], QueuedRun]] = {
            AcquireBracket: self._bracket,
            RunPlan: self._plan_file,
            ResumeRun: self._build_resumed_run,
        }

    def close(self) -> None:
        self._thread.shutdown(cancel_futures=True)

    def enqueue(self, command: RunRequest) -> None:
        """Begin to build a run, which is queued when it is built."""
        self._queue.expect_run()
        self._thread.submit(self._build_and_enqueue, command, partial(self._build, command))

    def restore(self, command: RestoreQueue) -> None:
        """Queue the runs of a session that ended, and hold them; none begins by itself."""
        for _ in command.requests:
            self._queue.expect_run()
        # Held before the first one can be ready.
        self._queue.hold(command.reason)
        for kept in command.requests:
            build = partial(self._restore_run, kept)
            self._thread.submit(self._build_and_enqueue, kept.request, build)

    def _build_and_enqueue(self, command: RunRequest, build: Callable[[], QueuedRun]) -> None:
        try:
            run = build()
        except Exception as error:
            self._queue.drop_expected()
            self._on_failure(command, error)
        else:
            run.ticket = command.ticket
            self._queue.add(run)
            self._on_ready()

    def _build(self, command: RunRequest) -> QueuedRun:
        return self._make[type(command)](command)

    def _restore_run(self, kept: KeptRequest) -> QueuedRun:
        """Build the rest of a run whose record was begun in an earlier session, or all of it."""
        path = kept.path or self._own_path(kept.request)
        if not path.exists():
            return self._build(kept.request)
        try:
            run = self._build_resumed_run(ResumeRun(path))
        except (UserError, OSError) as error:
            if isinstance(kept.request, ResumeRun):
                raise
            log.warning("%s: can't be gone on with, so that it is taken anew: %s", path, error)
            return self._build(kept.request)
        if run.info.stored_frames == run.info.planned_frames:
            # Only the word of its end didn't come.
            with Record(path) as record:
                if record.state is State.COMPLETE:
                    run.mark_ended(State.COMPLETE, "")
        return run

    def _own_path(self, request: RunRequest) -> Path:
        """Return the path that a request's record had, if it was begun."""
        if isinstance(request, ResumeRun):
            return request.path
        name = "bracket"
        if isinstance(request, RunPlan):
            name = read_file(request.plan, PlanFile).title
        return request.folder / f"{_stem(name, request.ticket)}.h5"

    def _bracket(self, command: AcquireBracket) -> QueuedRun:
        return self._build_run(build_bracket_plan(command), command, "bracket", "bracket", Path())

    def _plan_file(self, command: RunPlan) -> QueuedRun:
        plan = read_file(command.plan, PlanFile)
        return self._build_run(plan, command, plan.title, str(command.plan), command.plan.parent)

    def _build_run(
        self,
        plan: PlanFile,
        request: AcquireBracket | RunPlan,
        name: str,
        source: str,
        pictures: Path,
    ) -> QueuedRun:
        sensor = self._bench.description.sensor
        listed = feasible_shots(
            expected_plan(plan, self._abilities, sensor, source), self._abilities, source
        )
        make_folder(request.folder)
        path = self._new_path(request.folder, _stem(name, request.ticket))
        return QueuedRun(
            plan.title,
            path,
            partial(run_plan, self._bench, plan, path, source=source, folder=pictures),
            self._timing(listed),
            planned_frames=len(listed),
            stored_frames=0,
        )

    def _build_resumed_run(self, command: ResumeRun) -> QueuedRun:
        path = command.path
        if self._queue.has_record(path):
            raise UserError(f"{path}: is in the queue already. Wait for it to end.")
        with Record(path) as record:
            title, plan = record.text("title"), record.plan
            missing = record.frames_not_stored()
        listed = feasible_shots(plan, self._abilities, str(path))
        return QueuedRun(
            title,
            path,
            partial(resume_run, self._bench, path),
            self._timing(listed.pick(missing)),
            planned_frames=len(listed),
            stored_frames=len(listed) - len(missing),
        )

    def _timing(self, listed: Sequence[Shot]) -> RunTiming:
        return RunTiming(listed, virtual=not self._bench.file.is_real, costs=self._costs)

    def _new_path(self, folder: Path, stem: str) -> Path:
        """Return a path for a record that no file and no queued run has."""
        path, number = folder / f"{stem}.h5", 1
        while path.exists() or self._queue.has_record(path):
            number += 1
            path = folder / f"{stem}-{number}.h5"
        return path


def _stem(name: str, ticket: str) -> str:
    """Return the name of a run's record: the request's ticket, and the run's name."""
    words = re.sub(r"\W+", "-", name.lower()).strip("-")[:60] or "run"
    return f"{ticket or format(datetime.now(), '%Y-%m-%d_%H%M%S')}_{words}"
