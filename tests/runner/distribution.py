"""The process that hands the tests out to its workers, and what it does for those that die."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import execnet
import pytest
from xdist.workermanage import WorkerController

from runner.durations import Durations
from runner.orphans import Orphans
from runner.schedule import Schedule
from runner.units import read_units, write_units

_STILLBORN = 4
"""Workers that may die before they have collected the tests: then it isn't a test's fault."""


class Distribution:
    """A plugin. notes: a folder that the workers write to."""

    def __init__(self, notes: Path) -> None:
        self._notes, self._orphans = notes, Orphans()
        self._stillborn = 0

    def pytest_configure_node(self, node: WorkerController) -> None:
        node.workerinput["notes"] = str(self._notes)

    def pytest_xdist_newgateway(self, gateway: execnet.Gateway) -> None:
        self._orphans.workers.add(gateway._rinfo().pid)

    def pytest_xdist_make_scheduler(self, config: pytest.Config) -> Schedule:
        self._schedule = Schedule(config, self._units, Durations(config).of)
        return self._schedule

    def _units(self) -> Any:
        return read_units(_units_file(self._notes))

    @pytest.hookimpl(tryfirst=True)
    def pytest_testnodedown(self, node: WorkerController, error: object) -> None:
        if not error:
            return
        self._orphans.workers.discard(node.gateway._rinfo().pid)
        self._orphans.end()
        if not self._schedule.has_collected(node):
            self._stillborn += 1
            if self._stillborn >= _STILLBORN:
                pytest.exit(f"Workers die before they have collected tests.\n{self._words(node)}")

    def pytest_handlecrashitem(self, crashitem: str, report: pytest.TestReport) -> None:
        words = self._words(report.node)
        report.longrepr = words or f"{crashitem} ended its process without a word."

    def _words(self, node: WorkerController) -> str:
        file = words_file(self._notes, node.gateway.id)
        return file.read_text() if file.exists() else ""

    def pytest_unconfigure(self) -> None:
        self._orphans.close()


class Worker:
    """A plugin for the workers of such a process."""

    def __init__(self, notes: Path) -> None:
        self._notes = notes

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_finish(self, session: pytest.Session) -> None:
        write_units(_units_file(self._notes), session.items)


def _units_file(notes: Path) -> Path:
    return notes / "units.json"


def words_file(notes: Path, worker: str) -> Path:
    """Where a worker says why it ends."""
    return notes / f"{worker}.txt"
