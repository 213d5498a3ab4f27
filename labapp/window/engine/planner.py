"""From what the window asks for to a run in line: read, checked and named beforehand."""

from __future__ import annotations

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
from labapp.runs.abilities import Abilities
from labapp.runs.acquisition.checking import checked_shots
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.record.reader import Record
from labapp.runs.steps import Shot
from labapp.window.engine.plan import bracket_plan
from labapp.window.engine.run import Run
from labapp.window.engine.run_queue import RunQueue
from labapp.window.engine.timing import Timing
from labapp.window.messages import Acquire, ResumeRun, RunPlan

_LONGEST_NAME = 60


class Planner:
    """Puts runs in line, in a thread of its own: a slow disk holds nothing else up.

    What a bench can't do is refused now, not in the middle of the night. What the bench can
    is asked once, for its devices are busy while another run is under way.
    failed: is called with what kept a run from being put in line. ready: after one was.
    """

    def __init__(
        self,
        bench: Bench,
        queue: RunQueue,
        *,
        failed: Callable[[Exception], None],
        ready: Callable[[], None],
    ) -> None:
        self._bench, self._queue, self._failed, self._ready = bench, queue, failed, ready
        self._abilities = Abilities.of(bench)
        self._thread = ThreadPoolExecutor(1, "planner")
        self._make: dict[type, Callable[[Any], Run]] = {
            Acquire: self._bracket,
            RunPlan: self._plan_file,
            ResumeRun: self._resumed,
        }

    def close(self) -> None:
        self._thread.shutdown(cancel_futures=True)

    def line_up(self, command: Acquire | RunPlan | ResumeRun) -> None:
        self._queue.expect()
        self._thread.submit(self._try, command)

    def _try(self, command: Acquire | RunPlan | ResumeRun) -> None:
        try:
            run = self._make[type(command)](command)
        except Exception as error:
            self._queue.dismiss()
            self._failed(error)
        else:
            self._queue.add(run)
            self._ready()

    def _bracket(self, command: Acquire) -> Run:
        return self._planned(bracket_plan(command), command.folder, "bracket", "bracket", Path())

    def _plan_file(self, command: RunPlan) -> Run:
        plan = read_file(command.plan, PlanFile)
        return self._planned(
            plan, command.folder, plan.title, str(command.plan), command.plan.parent
        )

    def _planned(self, plan: PlanFile, folder: Path, name: str, source: str, pictures: Path) -> Run:
        listed = checked_shots(plan, self._abilities, source)
        make_folder(folder)
        path = self._new_path(folder, name)
        return Run(
            plan.title,
            path,
            partial(run_plan, self._bench, plan, path, source=source, folder=pictures),
            self._timing(listed),
            planned=len(listed),
            stored=0,
        )

    def _resumed(self, command: ResumeRun) -> Run:
        path = command.path
        if self._queue.has(path):
            raise UserError(f"{path}: is in the queue already. Wait for it to end.")
        with Record(path) as record:
            title, plan = record.text("title"), record.plan
            missing = set(record.not_stored())
        listed = checked_shots(plan, self._abilities, str(path))
        return Run(
            title,
            path,
            partial(resume_run, self._bench, path),
            self._timing([shot for shot in listed if shot.index in missing]),
            planned=len(listed),
            stored=len(listed) - len(missing),
        )

    def _timing(self, listed: Sequence[Shot]) -> Timing:
        seconds = sum(shot.lasts for shot in listed)
        return Timing(seconds, len(listed), virtual=not self._bench.file.is_real)

    def _new_path(self, folder: Path, name: str) -> Path:
        """A file named after the moment and the run, that nobody has and no run will have."""
        words = re.sub(r"\W+", "-", name.lower()).strip("-")[:_LONGEST_NAME] or "run"
        stem = f"{datetime.now():%Y-%m-%d_%H%M%S}_{words}"
        path, number = folder / f"{stem}.h5", 1
        while path.exists() or self._queue.has(path):
            number += 1
            path = folder / f"{stem}-{number}.h5"
        return path
