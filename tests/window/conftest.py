"""A real window on a virtual X display, and a person who clicks and looks.

Most tests share one window. What a failed test leaves behind is thrown away, so that the next
one begins with a fresh window.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import dialogues
import forked
import pytest
import watchdog
from person import Person
from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtGui import QScreen
from PySide6.QtWidgets import QApplication, QFileDialog
from shared_window import SharedWindow
from waits import wait_until
from window_bench import Bench
from window_scene import write_bench

from drivers.hosted import child_process
from labapp.bench.opening import BenchFiles
from labapp.common.speed import save_speed
from labapp.window import theme
from labapp.window.alignment_panel import AlignmentPanel
from optics.accuracy import MachineSpeed
from simulator.screens import NoXServer, xvfb
from simulator.screens.server import authority_file

_INSTALL = "sudo apt-get install xvfb libegl1 libxkbcommon-x11-0 libxcb-cursor0 libxcb-icccm4"

_REDRAWS = 15.0
"""Of a screen, by second."""

_began = pytest.StashKey[float]()
_failed = pytest.StashKey[bool]()
_watchdog = watchdog.Watchdog()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    item.stash[_began] = time.monotonic()
    with _phase(_longest(item)):
        return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    left = item.stash[_began] + _longest(item) - time.monotonic()
    with _phase(max(left, 1.0)):
        return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown() -> Generator[None, object, object]:
    with _phase(watchdog.LONGEST_TEARDOWN):
        return (yield)


def pytest_enter_pdb() -> None:
    """A person at a breakpoint isn't late."""
    _watchdog.set_no_limit()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed:
        item.stash[_failed] = True
    return report


def _longest(item: pytest.Item) -> float:
    """Seconds of a test with its setup: somewhat less than pytest-timeout gives it."""
    marker = item.get_closest_marker("timeout")
    return 0.8 * marker.args[0] if marker else watchdog.LONGEST


@contextmanager
def _phase(seconds: float) -> Iterator[None]:
    """A part of a test: it ends, and no dialogue comes in it that nobody expects."""
    dialogues.forget()
    try:
        with _watchdog.limit(seconds):
            yield
    except BaseException as error:
        dialogues.note_on(error)
        raise
    dialogues.require_none()


@pytest.fixture(scope="session")
def slow_machine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What is kept of a machine on which no picture is restored in a hundredth of a second."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        save_speed(replace(MachineSpeed(), call=5e-3))
    return folder


@pytest.fixture(autouse=True)
def on_a_slow_machine(slow_machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Engines read it instead of measuring this one, and nobody's cache is written."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(slow_machine))


@pytest.fixture(scope="module", autouse=True)
def forked_engines() -> Iterator[None]:
    """Engines needn't load their libraries; test_window_opens.py has one that does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child_process, "subprocess", forked)
        yield


@pytest.fixture(scope="session")
def display() -> Iterator[None]:
    """An X server of our own, so that nothing opens on a person's screen."""
    with ExitStack() as stack:
        try:
            server = stack.enter_context(xvfb(1600, 900))
        except NoXServer as error:
            if "DISPLAY" not in os.environ:
                pytest.fail(f"These tests need an X display: {error}. Install all: {_INSTALL}")
            yield
            return
        os.environ.update(DISPLAY=server.display, QT_QPA_PLATFORM="xcb")
        # Windows whose home is another folder use the display, too.
        os.environ["XAUTHORITY"] = str(authority_file())
        yield
        # Qt must let go of the display first; it ends the process if the display goes.
        application = QApplication.instance()
        if application is not None:
            application.shutdown()


@pytest.fixture(scope="session")
def qapp_args(display: None) -> list[str]:
    """The display must be there before Qt looks for it."""
    # A desktop's own dialogues can be neither read nor closed.
    QCoreApplication.setAttribute(Qt.ApplicationAttribute.AA_DontUseNativeDialogs)
    return ["labapp-tests"]


@pytest.fixture(scope="session")
def qapp(qapp: QApplication) -> Iterator[QApplication]:
    """pytest-qt's application, with somebody who closes dialogues and ends endless loops."""
    _watchdog.look_from_qt()
    yield qapp
    _watchdog.stop()


@pytest.fixture(scope="module", autouse=True)
def slow_screen() -> Iterator[None]:
    """Live pictures come as often as a screen is redrawn: here, no more often than a test looks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(QScreen, "refreshRate", lambda _: _REDRAWS)
        yield


@pytest.fixture(scope="session")
def dark_theme(qapp: QApplication) -> None:
    theme.apply_theme(qapp)


@pytest.fixture(scope="session")
def shared_window(
    dark_theme: None, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[SharedWindow]:
    shared = SharedWindow(tmp_path_factory)
    yield shared
    shared.close()


@pytest.fixture
def bench(
    request: pytest.FixtureRequest, shared_window: SharedWindow, qtbot: Any
) -> Iterator[Bench]:
    """The shared window, live, on the photograph with the neutral pattern."""
    yield shared_window.ready(qtbot)
    if request.node.stash.get(_failed, False):
        shared_window.discard()


@pytest.fixture
def new_bench(
    request: pytest.FixtureRequest,
    shared_window: SharedWindow,
    tmp_path: Path,
    qtbot: Any,
) -> Iterator[Callable[..., Bench]]:
    """A window of one's own, whose engine begins to start; of the files that are given."""
    shared_window.rest()
    opened: list[Bench] = []

    def open_(**files: Path | None) -> Bench:
        opened.append(Bench(tmp_path, **files))
        return opened[-1]

    yield open_
    for bench in opened:
        bench.close(kill=request.node.stash.get(_failed, False))


@pytest.fixture
def own_bench(new_bench: Callable[..., Bench], tmp_path: Path) -> Callable[..., Bench]:
    """Open a window of one's own, with faults (a fault file's text).

    On the small bench if no other is given.
    """

    def open_(faults: str = "", files: BenchFiles | None = None) -> Bench:
        files = files or write_bench(tmp_path)
        file = tmp_path / "faults.toml"
        file.write_text(f"version = 1\n{faults}")
        bench = new_bench(bench=files.bench, scene=files.scene, faults=file if faults else None)
        wait_until(bench.window.actions_["acquire"].isEnabled, bench.describe)
        return bench

    return open_


@pytest.fixture
def chosen_file(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Choose this file in the next dialogue for one."""

    def choose(path: Path) -> None:
        answer = staticmethod(lambda *_: (str(path), ""))
        monkeypatch.setattr(QFileDialog, "getOpenFileName", answer)

    return choose


@pytest.fixture
def person(bench: Bench, qtbot: Any) -> Person:
    return Person(bench, qtbot)


@pytest.fixture
def align(bench: Bench, person: Person) -> Iterator[AlignmentPanel]:
    """The panel, with the star before the camera and no marks on the picture; then the queue's."""
    panel = bench.window.alignment
    person.presses(Qt.Key.Key_F9)
    person.waits(panel.isVisible)
    for switch in (panel.region, panel.line, panel.cross):
        if switch.isChecked():
            person.clicks(switch)
    person.chooses(bench.window.settings.target, "star")
    person.types(bench.window.settings.exposure, "1")
    person.waits(lambda: bench.frame.target == "star" and bench.frame.exposure == 1e-3)
    yield panel
    bench.window.live_view.picture.fit()
    bench.window.show_queue()
