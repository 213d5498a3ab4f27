"""Runs the related tests, first without a mutant and then with each."""

from __future__ import annotations

import json
import math
import os
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from mutants.changes import Mutant
from mutants.forks import OVERLAY, in_a_fork, load
from mutants.overlay import sitecustomize

SLOWEST = 600.0
"""Seconds after which a file's tests count as hanging, without a mutant."""

ELSEWHERE = 10.0
"""Seconds for tests that don't come to a mutant's lines, but stand beside tests that do: what those
worked out and kept, they may look at."""


@dataclass
class TestFile:
    """One file's tests without a mutant."""

    path: Path
    seconds: float
    reached: set[int] = field(default_factory=set)
    """Lines of the module, reached by its tests or by processes that they start."""
    by_test: dict[str, set[int]] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)
    """Tests that fail even so; they are left out."""

    @property
    def useful(self) -> bool:
        """Whether a test comes to the module, rather than an import alone."""
        return any(self.by_test)

    def nearest(self, lines: range) -> list[str]:
        return [test for test, reached in self.by_test.items() if reached & set(lines)]


@dataclass(frozen=True)
class Verdict:
    mutant: Mutant
    killed_by: str | None
    """The first test that failed, or what else happened; None: it survived."""
    tests: int
    """Files of tests that come to its lines."""


class Bench:
    """The tests of one module, in forks of this process."""

    def __init__(self, root: Path, module: Path):
        self.root, self.module = root, module
        self.name = ".".join(module.relative_to(root).with_suffix("").parts)
        self.name = self.name.removesuffix(".__init__")

    def without_a_mutant(self, test: Path, seconds: float) -> TestFile:
        """Which lines a file's tests come to, and how long they take; of a long file, the tests
        that begin in so many seconds."""
        with tempfile.TemporaryDirectory() as folder:
            log, kept = Path(folder, "lines"), Path(folder, "kept")
            environment = {sitecustomize.REACHED: _joined(self.module, log)}

            def work(place: Path) -> int:
                seen = _Seen(sitecustomize.watch(), seconds)
                code = _pytest(self.root, place, [test], seen)
                sys.settrace(None)
                seen.keep(kept, self.root)
                return code

            ended = in_a_fork(work, environment, SLOWEST)
            if not kept.exists():
                raise RuntimeError(f"{test} didn't end:\n{ended.output[-2000:]}")
            notes = json.loads(kept.read_text())
            load(notes["libraries"])
            file = TestFile(test, ended.seconds, failed=notes["failed"])
            for line in log.read_text().splitlines() if log.exists() else []:
                number, _, name = line.partition(" ")
                file.reached.add(int(number))
                file.by_test.setdefault(name, set()).add(int(number))
        return file

    def verdict(self, mutant: Mutant, files: list[TestFile]) -> Verdict:
        """Whether a test of these files fails with a mutant."""
        files = [one for one in files if one.reached & set(mutant.lines)]
        if not files:
            return Verdict(mutant, None, 0)
        with tempfile.TemporaryDirectory() as folder:
            text, kept = Path(folder, "mutant.py"), Path(folder, "kept")
            text.write_text(mutant.text)
            environment = {sitecustomize.MODULE: _joined(self.name, self.module, text)}

            def work(place: Path) -> int:
                sitecustomize.replace()
                first = _First(files, mutant.lines, kept)
                return _pytest(self.root, place, [one.path for one in files], first, "-x")

            ended = in_a_fork(work, environment, 15 + 4 * sum(one.seconds for one in files))
            name = kept.read_text() if kept.exists() else "at import"
        if ended.code is None:
            name = "time-out"
        elif ended.code < 0 or ended.code > 5:
            name = f"ended with {ended.code}"
        return Verdict(mutant, None if ended.code == 0 else name, len(files))


def _joined(*parts: object) -> str:
    return os.pathsep.join(map(str, parts))


def _pytest(root: Path, place: Path, tests: list[Path], plugin: object, *more: str) -> int:
    os.chdir(root)
    options = ["-q", "-p", "no:cacheprovider", f"--rootdir={root}", f"--basetemp={place}/tmp"]
    # Plugins are among the libraries that stay loaded; what they assert needs no explanation.
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning", *more]
    return int(pytest.main([*map(str, tests), *options], plugins=[plugin]))


class _Limited:
    """Leaves out the tests that would begin after a time."""

    latest = math.inf

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> bool | None:
        return True if time.monotonic() > self.latest else None


class _Seen(_Limited):
    """Says whose lines are noted, and keeps which tests failed and which libraries were loaded."""

    def __init__(self, watch: sitecustomize.Watch, seconds: float):
        self._watch, self._before = watch, set(sys.modules)
        self._failed: set[str] = set()
        self._seconds = seconds

    def pytest_runtestloop(self) -> None:
        self.latest = time.monotonic() + self._seconds

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._watch.of(nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._failed.add(report.nodeid)

    def keep(self, file: Path, root: Path) -> None:
        libraries = [
            name
            for name, module in list(sys.modules.items())
            if name not in self._before and _of_a_library(getattr(module, "__file__", None), root)
        ]
        file.write_text(json.dumps({"failed": sorted(self._failed), "libraries": libraries}))


def _of_a_library(file: str | None, root: Path) -> bool:
    if file is None:
        return False
    inside = Path(file).is_relative_to(root) and "site-packages" not in file
    return not inside and not Path(file).is_relative_to(OVERLAY)


class _First(_Limited):
    """Runs those tests first that come to a mutant's lines, file by file, and keeps who failed."""

    def __init__(self, files: list[TestFile], lines: range, kept: Path):
        self._order = {one.path: at for at, one in enumerate(files)}
        self._near = {name for one in files for name in one.nearest(lines)}
        self._failed = {name for one in files for name in one.failed}
        self._kept = kept

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted(
            (one for one in items if one.nodeid not in self._failed),
            key=lambda one: (one.nodeid not in self._near, self._order[one.path]),
        )

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        if nodeid not in self._near and self.latest == math.inf:
            self.latest = time.monotonic() + ELSEWHERE

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self._kept.exists():
            self._kept.write_text(report.nodeid)
