"""A window in which everything goes on at once, and how long its event loop is held up.

As a script, `python busy_walk.py FOLDER` opens a window of its own on a virtual bench of 5
megapixels and an X server in memory, works in it, and prints as one JSON line how many
milliseconds the loop was late at worst in each step, beyond waiting for a core.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

from figures.window_changes import bundled_bench
from person import Person
from PySide6.QtCore import QObject, QPoint, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QWidget
from window_bench import Bench

from labapp.files.reading import bundled_path
from labapp.window.measuring_messages import PictureMeasured
from labapp.window.messages import ReconstructionResult, RunEnded

_BEAT = 5
"""Milliseconds between beats of an event loop that has nothing else to do."""

_PATIENCE = 150.0
"""Seconds for what is computed at 5 megapixels beside all else."""


class Heartbeat(QObject):
    """Beats in the event loop, and notes in each step by how much a beat was late at worst.

    Time in which the thread could run but had no core is the machine's, and not counted: Linux
    tells it in schedstat.
    """

    def __init__(self) -> None:
        super().__init__()
        self.late_ms: dict[str, float] = {}
        self.beats = 0
        self._step = "opening"
        self._timer = QTimer(self, interval=_BEAT)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._beat)
        self._last, self._waited = time.monotonic(), _waiting_seconds()
        self._timer.start()

    def begin(self, step: str) -> None:
        self._step = step

    def _beat(self) -> None:
        now, waited = time.monotonic(), _waiting_seconds()
        late = now - self._last - (waited - self._waited) - 1e-3 * _BEAT
        self._last, self._waited = now, waited
        self.beats += 1
        self.late_ms[self._step] = max(self.late_ms.get(self._step, 0.0), round(1e3 * late, 1))


def _waiting_seconds() -> float:
    """Time that this thread was ready to run, and didn't."""
    return int(Path("/proc/thread-self/schedstat").read_text().split()[1]) * 1e-9


class BusyWalk:
    """Everything that a person would do, while the picture is live."""

    def __init__(self, bench: Bench, person: Person, beat: Heartbeat) -> None:
        self._bench, self._person, self._window, self._beat = bench, person, bench.window, beat

    def go(self) -> None:
        steps = (
            self._live, self._align, self._patterns, self._contrast, self._zoom, self._why,
            self._docks, self._acquire, self._restore, self._measure, self._help,
        )  # fmt: skip
        for step in steps:
            self._beat.begin(step.__name__.strip("_"))
            step()

    def _waits(self, seen) -> None:
        self._person.waits(seen, patience=_PATIENCE)

    def _frames(self, count: int) -> None:
        """Live pictures that come meanwhile."""
        wanted = self._bench.frames + count
        self._waits(lambda: self._bench.frames >= wanted)

    def _live(self) -> None:
        self._person.chooses(self._window.settings.target, "photograph")
        self._waits(lambda: self._bench.frame.target == "photograph")
        self._frames(30)

    def _align(self) -> None:
        """With its region, statistics and focus score, which go on from here."""
        self._person.presses(Qt.Key.Key_F9)
        self._bench.reports.clear()
        self._person.clicks(self._window.alignment.region)
        self._waits(lambda: self._bench.last(PictureMeasured) is not None)
        self._frames(20)

    def _patterns(self) -> None:
        for kind in ("Fresnel lens", "Axicon", "Cubic"):
            before = self._bench.frame.pattern
            self._person.shows(kind)
            self._waits(lambda before=before: self._bench.frame.pattern != before)

    def _contrast(self) -> None:
        """Drag a handle of the histogram to and fro."""
        view = self._window.live_view.histogram
        self._drag(view.plot.viewport(), view.handle_position(1), [QPoint(-40, 0), QPoint(30, 0)])
        self._frames(3)

    def _zoom(self) -> None:
        """Into the picture, about in it, and out again."""
        picture = self._window.live_view.picture
        port = picture._view.viewport()
        picture.show_true_size()
        self._frames(3)
        middle = port.rect().center()
        self._drag(port, middle, [QPoint(80, 40), QPoint(-60, -30)])
        picture.fit()
        self._frames(3)

    def _drag(self, port: QWidget, start: QPoint, moves: list[QPoint]) -> None:
        QTest.mousePress(port, Qt.MouseButton.LeftButton, pos=start)
        for move in moves:
            for share in range(1, 6):
                QTest.mouseMove(port, start + move * (share / 5))
                QTest.qWait(30)
        QTest.mouseRelease(port, Qt.MouseButton.LeftButton, pos=start + moves[-1])

    def _why(self) -> None:
        self._person.presses(Qt.Key.Key_W)
        self._frames(10)
        self._person.presses(Qt.Key.Key_W)

    def _docks(self) -> None:
        """Each panel away and back; the themes; all tabs."""
        for dock in self._window.docks.values():
            dock.hide()
            self._frames(1)
            dock.show()
            self._frames(1)
        for name in ("dim", "red", "red", "dim", "marks", "marks"):
            self._window.actions_[name].trigger()
            self._frames(2)
        for number in (1, 2, 3, 0):
            self._window.tabs.setCurrentIndex(number)
            self._frames(2)
        self._window.actions_["reset"].trigger()
        self._frames(2)

    def _acquire(self) -> None:
        run = self._window.run
        for row, count in ((run.star, "2"), (run.photograph, "1")):
            self._person.types(row.count, count)
        self._bench.reports.clear()
        self._person.presses(Qt.Key.Key_F6)
        self._waits(lambda: self._bench.stored > 3)
        self._person.presses(Qt.Key.Key_F8)
        self._waits(lambda: self._window.prompt_bar.isVisible())
        QTest.qWait(500)
        self._person.presses(Qt.Key.Key_F8)
        asks = self._window.prompt_bar

        def is_over() -> bool:
            if asks.is_asking:
                self._person.clicks(asks.other_button)
            return self._bench.last(RunEnded) is not None

        self._waits(is_over)
        assert self._bench.last(RunEnded).state == "COMPLETE", self._bench.last(RunEnded)

    def _restore(self) -> None:
        self._waits(self._window.actions_["reconstruct"].isEnabled)
        self._bench.reports.clear()
        self._person.presses(Qt.Key.Key_F7)
        self._waits(lambda: self._bench.last(ReconstructionResult) is not None)
        self._frames(10)

    def _measure(self) -> None:
        """What accuracy costs, measured for a while; live view rests meanwhile."""
        self._window.tabs.setCurrentWidget(self._window.accuracy)
        self._person.clicks(self._window.accuracy.measure)
        QTest.qWait(3000)
        self._person.cancels()
        self._waits(lambda: not self._window.session.job)
        self._window.tabs.setCurrentWidget(self._window.live_view)

    def _help(self) -> None:
        self._person.presses(Qt.Key.Key_F1)
        self._waits(lambda: self._window.help is not None and self._window.help.isVisible())
        self._frames(10)
        self._window.help.close()


def main() -> None:
    from labapp.common.memory import keep_freed_memory, lasting_objects
    from simulator.screens import xvfb

    # As the command does.
    keep_freed_memory()
    folder = Path(sys.argv[1])
    file = folder / "bench.toml"
    file.write_text(bundled_bench(2448, 2048))
    with xvfb(1920, 1080) as server:
        os.environ.update(DISPLAY=server.display, QT_QPA_PLATFORM="xcb")
        from PySide6.QtWidgets import QApplication

        from labapp.window import theme

        application = QApplication(["walk"])
        theme.apply_theme(application)
        with lasting_objects():
            bench = Bench(folder, bench=file, scene=bundled_path("scene.toml"))
        try:
            person = Person(bench, QTest)
            person.waits(lambda: bench.frame is not None, patience=_PATIENCE)
            beat = Heartbeat()
            BusyWalk(bench, person, beat).go()
        finally:
            bench.close()
        print(json.dumps({"late_ms": beat.late_ms, "beats": beat.beats}), flush=True)
        application.shutdown()


if __name__ == "__main__":
    main()
