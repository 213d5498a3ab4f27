"""What all tests together may cost in processor time, on a machine of any speed."""

from __future__ import annotations

import math
import os
import time
import tomllib
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import pytest

from runner.costs import cpu_seconds

_PIECES = 5
_AT_HOME = 0.5
"""Processor seconds that the calibration takes on the machine where the budget was counted."""


@dataclass(frozen=True)
class Spent:
    """Processor seconds. slowness: of this machine, over the one where `budget` was counted."""

    used: float
    budget: float
    slowness: float

    @property
    def allowed(self) -> float:
        return self.budget * self.slowness

    @property
    def is_too_much(self) -> bool:
        return self.used > self.allowed

    def in_words(self) -> str:
        words = (
            f"{self.used:.0f} s of processor time in all; {self.allowed:.0f} s are allowed "
            f"({self.budget:g} s in pyproject.toml, times {self.slowness:.2f} for this machine)"
        )
        if self.is_too_much:
            words += ": make the dearest tests cheaper, or sweeps"
        return words


class CpuBudget:
    """A plugin for the process with the terminal: where CI is set, too much fails the run.

    Its workers are its children, and so are the processes that they have started and waited for.
    """

    def __init__(self, config: pytest.Config) -> None:
        self._budget = read_budget(config.rootpath / "pyproject.toml")
        self._slowness = measure_slowness()
        self._spent: Spent | None = None

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> Generator[None]:
        # Workers have ended when all others are through, and the summary is still to come.
        yield
        self._spent = Spent(cpu_seconds(), self._budget, self._slowness)
        if self._spent.is_too_much and os.environ.get("CI") and session.exitstatus == 0:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._spent:
            too_much = self._spent.is_too_much
            terminalreporter.write_line(self._spent.in_words(), red=too_much, bold=too_much)


def read_budget(project: Path) -> float:
    """The processor seconds of a project's file. They are no option of pytest's own table, which
    pytest would refuse where somebody else's tests are run in the checkout."""
    table = tomllib.loads(project.read_text()) if project.exists() else {}
    return float(table.get("tool", {}).get("labapp-tests", {}).get("cpu_budget", math.inf))


def is_all(config: pytest.Config) -> bool:
    """Whether all tests are run but sweeps: a budget says nothing of some of them."""
    ini = config.args_source == pytest.Config.ArgsSource.TESTPATHS
    chosen = (config.option.keyword, config.option.deselect, config.getoption("lf", False))
    return ini and config.option.markexpr == "not sweep" and not any(chosen)


def measure_slowness() -> float:
    """How much longer than at home a fixed work takes: half numpy's, half Python's.

    The quickest piece counts, for others may have been disturbed.
    """
    return _PIECES * min(time_a_piece() for _ in range(_PIECES)) / _AT_HOME


def time_a_piece() -> float:
    """In processor seconds; the work is the same each time."""
    import numpy as np

    before = time.process_time()
    square = np.random.default_rng(0).random((256, 256))
    for _ in range(10):
        square = np.abs(np.fft.ifft2(np.fft.fft2(square @ square)))
        square /= square.max()
    total, names = 0, {}
    for number in range(350_000):
        names[number % 997] = total
        total += number * number % 7
    return time.process_time() - before
