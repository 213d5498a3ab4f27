"""The window that most tests share, and what it is replaced for."""

from __future__ import annotations

from typing import Any

import pytest
from person import Person
from waits import PATIENCE, wait_until
from window_bench import Bench
from window_scene import write_bench

from labapp.window.messages import LiveFrame

_SETTLING = 10.0
"""Seconds in which the window of a test before takes the settings that each test begins with."""


class SharedWindow:
    """One at a time, on the small bench; a new one where the one before is of no use any more."""

    def __init__(self, folders: pytest.TempPathFactory) -> None:
        self._folders = folders
        self._bench: Bench | None = None

    def ready(self, qtbot: Any) -> Bench:
        """Live, on the photograph with the neutral pattern."""
        if self._bench is not None and self._bench.connection.is_running:
            try:
                return self._settled(self._bench, qtbot, _SETTLING)
            except AssertionError:
                pass  # A test before has left it as no test wants it; that one may have passed.
        self.discard()
        return self._settled(self._opened(), qtbot, PATIENCE)

    def rest(self) -> None:
        """Take no pictures while a test looks at a window of its own."""
        if self._bench is not None and self._bench.window.actions_["live"].isChecked():
            self._bench.window.actions_["live"].trigger()

    def discard(self) -> None:
        """As it is, without asking anybody."""
        bench, self._bench = self._bench, None
        if bench is not None:
            bench.close(kill=True)

    def close(self) -> None:
        if self._bench is not None:
            self._bench.close()

    def _opened(self) -> Bench:
        folder = self._folders.mktemp("window")
        files = write_bench(folder)
        self._bench = bench = Bench(folder, bench=files.bench, scene=files.scene)
        wait_until(bench.window.actions_["live"].isEnabled, bench.describe)
        return bench

    def _settled(self, bench: Bench, qtbot: Any, patience: float) -> Bench:
        person, window = Person(bench, qtbot), bench.window
        bench.reports.clear()
        person.waits(lambda: bench.idle, patience=patience)
        person.waits(window.actions_["live"].isEnabled, patience=patience)
        window.message.acknowledge()
        window.tabs.setCurrentWidget(window.live_view)
        window.live_view.picture.fit()
        for text in (window.pattern.form.texts[kind, "file"] for kind in ("image", "logo")):
            text.clear()
        for name, wanted in (("why", False), ("live", True)):
            if window.actions_[name].isChecked() is not wanted:
                person.clicks(window.bar.buttons[name])
        person.chooses(window.settings.target, "photograph")
        person.types(window.settings.wavelength, "550")
        person.types(window.settings.exposure, "400")
        person.shows("Neutral")
        person.waits(lambda: _as_set(bench.frame), patience=patience)
        # That one may be of a run before, taken in the dark with the same settings; the next may
        # have been on its way.
        frames = bench.frames
        person.waits(lambda: bench.frames > frames + 1 and _as_set(bench.frame), patience=patience)
        return bench


def _as_set(frame: LiveFrame | None) -> bool:
    if frame is None:
        return False
    found = (frame.target, frame.pattern, round(frame.wavelength * 1e9), frame.exposure)
    return found == ("photograph", "neutral", 550, 0.4)
