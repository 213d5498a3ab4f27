"""A real window on a virtual X display, and a person who clicks and looks."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from eyes import pixels
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QCursor
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QFileDialog,
    QLineEdit,
    QTableView,
    QWidget,
)

from labapp.window import theme
from labapp.window.connection import Connection
from labapp.window.main_window import MainWindow
from labapp.window.messages import LiveFrame, QueueState, RunInfo
from labapp.window.remembered import Remembered
from simulator.screens import NoXServer, xvfb

_PATIENCE = 40_000
_INSTALL = "sudo apt-get install xvfb libegl1 libxkbcommon-x11-0 libxcb-cursor0 libxcb-icccm4"


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
        yield
        # Qt must let go of the display first; it ends the process if the display goes.
        application = QApplication.instance()
        if application is not None:
            application.shutdown()


@pytest.fixture(scope="session")
def qapp_args(display: None) -> list[str]:
    """The display must be there before Qt looks for it."""
    return ["labapp-tests"]


class Person:
    """Clicks, types and looks at one window; nothing is done behind the window's back."""

    def __init__(self, window: MainWindow, qtbot: Any) -> None:
        self.window, self._qtbot = window, qtbot

    def waits(self, seen: Callable[[], bool]) -> None:
        self._qtbot.waitUntil(seen, timeout=_PATIENCE)

    def clicks(self, widget: QWidget) -> None:
        assert widget.isVisible()
        assert widget.isEnabled()
        self._qtbot.mouseClick(widget, Qt.MouseButton.LeftButton)

    def presses(self, key: Qt.Key) -> None:
        self.window.activateWindow()
        self.waits(self.window.isActiveWindow)
        self._qtbot.keyClick(self.window, key)

    def types(self, field: QAbstractSpinBox | QLineEdit, text: str) -> None:
        field.selectAll()
        self._qtbot.keyClicks(field, text)
        self._qtbot.keyClick(field, Qt.Key.Key_Return)

    def chooses(self, box: QComboBox, text: str) -> None:
        for _ in range(box.count()):
            self._qtbot.keyClick(box, Qt.Key.Key_Up)
        while box.currentText() != text:
            before = box.currentIndex()
            self._qtbot.keyClick(box, Qt.Key.Key_Down)
            assert box.currentIndex() != before, f"{text} is not in the list"

    def selects(self, table: QTableView, row: int) -> None:
        place = table.visualRect(table.model().index(row, 0)).center()
        self._qtbot.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=place)

    def moves_mouse(self, widget: QWidget, place: QPoint) -> None:
        QCursor.setPos(widget.mapToGlobal(place))

    def looks_at(self, widget: QWidget) -> np.ndarray:
        """The pixels that are really on the screen there, (rows, columns, 3)."""
        return pixels(widget)

    def shows(self, kind: str) -> None:
        """Choose a kind of pattern and put it on the SLM."""
        self.chooses(self.window.pattern.form.kind, kind)
        self.clicks(self.window.pattern.show_button)


class Bench:
    """A window with its engine, the last frame that came, and how the queue stands."""

    def __init__(self, folder: Path, **files: Path | None) -> None:
        self.folder = folder
        self.connection = Connection(**files)
        self.window = MainWindow(self.connection, Remembered(folder / "window.ini"))
        self.window.run.folder.setText(str(folder / "runs"))
        self.frames = 0
        self.frame: LiveFrame | None = None
        self.reports: list[Any] = []
        self.connection.received.connect(self._hear)
        self.window.show()
        self.connection.start()

    def _hear(self, report: Any) -> None:
        if isinstance(report, LiveFrame):
            self.frames, self.frame = self.frames + 1, report
        else:
            self.reports.append(report)

    def last(self, kind: type) -> Any:
        return next((r for r in reversed(self.reports) if isinstance(r, kind)), None)

    @property
    def runs(self) -> list[RunInfo]:
        """As the table in the window has them."""
        return self.window.queue.table.runs.runs

    @property
    def states(self) -> list[str]:
        return [run.state.value for run in self.runs]

    @property
    def stored(self) -> int:
        """Frames of the run under way."""
        run = self.window.session.queue.under_way
        return run.stored if run else 0


@pytest.fixture(scope="session")
def dark_theme(qapp: QApplication) -> None:
    theme.apply(qapp)


@pytest.fixture(scope="session")
def shared_bench(dark_theme: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    bench = Bench(tmp_path_factory.mktemp("window"))
    yield bench
    bench.window.close()


@pytest.fixture
def bench(shared_bench: Bench, qtbot: Any) -> Bench:
    """The shared window, live, on the photograph with the neutral pattern."""
    window = shared_bench.window
    person = Person(window, qtbot)
    if window.message.restart.isVisible():
        person.clicks(window.message.restart)
    person.waits(window.actions_["live"].isEnabled)
    window.message.acknowledge()
    window.tabs.setCurrentWidget(window.live_view)
    person.chooses(window.settings.target, "photograph")
    person.types(window.settings.wavelength, "550")
    person.types(window.settings.exposure, "400")
    person.shows("Neutral")
    if not window.actions_["live"].isChecked():
        person.clicks(window.bar.buttons["live"])
    person.waits(lambda: _as_set(shared_bench.frame))
    return shared_bench


def _as_set(frame: LiveFrame | None) -> bool:
    if frame is None:
        return False
    found = (frame.target, frame.pattern, round(frame.wavelength * 1e9), frame.exposure)
    return found == ("photograph", "neutral", 550, 0.4)


@pytest.fixture
def own_bench(dark_theme: None, tmp_path: Path, qtbot: Any) -> Iterator[Callable[..., Bench]]:
    """Open a window of one's own, on a virtual bench with faults (a fault file's text).

    Of other files if they are given: bench, scene.
    """
    opened: list[Bench] = []

    def open_(faults: str = "", **files: Path) -> Bench:
        file = tmp_path / "faults.toml"
        file.write_text(f"version = 1\n{faults}")
        opened.append(Bench(tmp_path, faults=file if faults else None, **files))
        bench = opened[0]
        qtbot.waitUntil(bench.window.actions_["acquire"].isEnabled, timeout=60_000)
        return bench

    yield open_
    for bench in opened:
        # Nobody is there to answer a question.
        bench.connection.close()
        bench.window.session.show_queue(QueueState(()))
        bench.window.close()


@pytest.fixture
def chosen_file(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Choose this file in the next dialogue for one."""

    def choose(path: Path) -> None:
        answer = staticmethod(lambda *_: (str(path), ""))
        monkeypatch.setattr(QFileDialog, "getOpenFileName", answer)

    return choose


@pytest.fixture
def person(bench: Bench, qtbot: Any) -> Person:
    return Person(bench.window, qtbot)
