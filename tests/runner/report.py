"""What a person who runs the tests reads beside the dots."""

from __future__ import annotations

import os
import threading

import pytest

from runner.costs import Costs
from runner.durations import Durations
from runner.processes import HighestMemory

_ROWS = 10


class Reporter:
    """A plugin for the process with the terminal: failures at once, costs and memory at the end."""

    def __init__(self, config: pytest.Config) -> None:
        self._config, self._costs = config, Costs()
        self._memory, self._over = HighestMemory(os.getpid()), threading.Event()
        self._watch = threading.Thread(target=self._watch_memory, daemon=True)
        self._watch.start()

    def _watch_memory(self) -> None:
        while not self._over.wait(2.0):
            self._memory.look()

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._costs.add(report)
        if report.failed:
            terminal = self._config.pluginmanager.getplugin("terminalreporter")
            when = f" at {report.when}" if report.when in ("setup", "teardown") else ""
            terminal.write(
                f"\nFAILED{when} {report.nodeid}: {_reason(report)}\n", red=True, flush=True
            )

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self) -> None:
        self._over.set()
        self._watch.join()
        Durations(self._config).keep(self._costs.seconds())

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._costs:
            terminalreporter.section("costs")
            for line in self._costs.table(_ROWS):
                terminalreporter.write_line(line)
            peak = self._memory.seen / 2**30
            terminalreporter.write_line(f"{peak:.1f} GB of memory at most, all processes together")


def _reason(report: pytest.TestReport) -> str:
    """The first line of what went wrong."""
    crash = getattr(report.longrepr, "reprcrash", None)
    lines = (crash.message if crash else str(report.longrepr)).splitlines()
    return lines[0] if lines else ""
