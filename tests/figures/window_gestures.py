"""`python window_gestures.py BENCH SCENE PLAN FOLDER SEED STRAY MEANT`: what hands do at a window.

It opens the window on a bench, makes stray gestures without a run, in a paused one and in one
under way, then meant ones, and undoes settings. It prints one JSON line, and closes.
"""

from __future__ import annotations

import json
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QStyle, QStyleOptionSpinBox, QWidget

from labapp.window.app import open_window
from labapp.window.commands import (
    AcquireBracket,
    AnswerPrompt,
    Cancel,
    Command,
    PauseRun,
    PlaceTarget,
    ReconnectDevice,
    ReleaseQueue,
    ResumeRun,
    RunPlan,
    SetExposure,
    SetLive,
    SetWavelength,
    ShowPattern,
    ShowPatternAgain,
)
from labapp.window.commit_fields import CommitSpinBox
from labapp.window.engine_connection import EngineConnection
from labapp.window.main_window import MainWindow
from labapp.window.theme import DIFFERS_SIGN

MOVES = (
    PlaceTarget,
    SetWavelength,
    SetExposure,
    ShowPattern,
    ShowPatternAgain,
    AcquireBracket,
    RunPlan,
    ResumeRun,
    ReleaseQueue,
    ReconnectDevice,
    SetLive,
    PauseRun,
    AnswerPrompt,
    Cancel,
)
"""Commands that move the bench, or begin, stop or answer a run."""

_KEY = Qt.Key
_STRAY_KEYS = [
    *(Qt.Key(code) for code in range(_KEY.Key_A.value, _KEY.Key_Z.value + 1)),
    *(Qt.Key(code) for code in range(_KEY.Key_0.value, _KEY.Key_9.value + 1)),
    *(_KEY.Key_Up, _KEY.Key_Down, _KEY.Key_Left, _KEY.Key_Right, _KEY.Key_Home, _KEY.Key_End),
    *(_KEY.Key_PageUp, _KEY.Key_PageDown, _KEY.Key_Space, _KEY.Key_Return, _KEY.Key_Enter),
    *(_KEY.Key_Delete, _KEY.Key_Backspace, _KEY.Key_Comma, _KEY.Key_Period, _KEY.Key_Minus),
]
"""What an elbow or a cat presses. F-keys, Ctrl and Tab are left out: they are made on purpose."""

_PATIENCE = 5.0


class Hand:
    """A hand at the window: its events take the way of real ones, through the window's handle."""

    def __init__(self, window: MainWindow) -> None:
        self.window, self._handle = window, window.windowHandle()

    def clicks(self, widget: QWidget, place: QPoint | None = None) -> None:
        at = widget.mapTo(widget.window(), place or widget.rect().center())
        QTest.mouseClick(
            widget.window().windowHandle(),
            Qt.MouseButton.LeftButton,
            Qt.KeyboardModifier.NoModifier,
            at,
        )

    def drags(self, start: QPoint, end: QPoint) -> None:
        button, none = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
        QTest.mousePress(self._handle, button, none, start)
        for share in (0.3, 0.7, 1.0):
            QTest.mouseMove(self._handle, start + (end - start) * share)
        QTest.mouseRelease(self._handle, button, none, end)

    def turns(self, place: QPoint, steps: int, *, ctrl: bool = False) -> None:
        """Turn the wheel at a place of the window."""
        keys = Qt.KeyboardModifier.ControlModifier if ctrl else Qt.KeyboardModifier.NoModifier
        QTest.wheelEvent(self._handle, QPointF(place), QPoint(0, 120 * steps), QPoint(), keys)

    def presses(self, key: Qt.Key, *, ctrl: bool = False) -> None:
        keys = Qt.KeyboardModifier.ControlModifier if ctrl else Qt.KeyboardModifier.NoModifier
        self.takes_focus()
        QTest.keyClick(self._handle, key, keys)

    def takes_focus(self) -> None:
        """Activate the window: without a window manager, nobody does after a list was open."""
        if not QApplication.activePopupWidget() and not self.window.isActiveWindow():
            self.window.activateWindow()
            wait(self.window.isActiveWindow)

    def types(self, field: QWidget, text: str) -> None:
        """Click into a field, type over what it has, and press Enter."""
        self.clicks(field)
        self.presses(Qt.Key.Key_A, ctrl=True)
        for letter in text:
            self.presses(Qt.Key(ord(letter)))
        self.presses(Qt.Key.Key_Return)

    def closes_lists(self) -> None:
        """Close what a stray gesture has opened, a list or the menu of a field."""
        for _ in range(5):
            if QApplication.activePopupWidget() is None:
                return
            self.presses(Qt.Key.Key_Escape)

    def stray(self, rng: random.Random) -> str:
        """Make a gesture that nobody means, anywhere in the window; what it was."""
        kind = rng.choices(("wheel", "key", "escape", "drag"), (35, 30, 10, 25))[0]
        start = self._somewhere(rng)
        if kind == "wheel":
            self.turns(start, rng.choice((-3, -1, 1, 3)))
        elif kind == "drag":
            short = QPoint(rng.randint(12, 40), rng.randint(-6, 6))
            self.drags(start, start + short if rng.random() < 0.4 else self._somewhere(rng))
        else:
            self.presses(Qt.Key.Key_Escape if kind == "escape" else rng.choice(_STRAY_KEYS))
        return kind

    def _somewhere(self, rng: random.Random) -> QPoint:
        """A place in the window: half of the time on a field or a button that sets something."""
        window = self.window
        if rng.random() < 0.5:
            settings, buttons = window.settings, list(window.bar.buttons.values())
            fields = [settings.target, settings.wavelength, settings.exposure]
            chosen = rng.choice([*fields, *fields, window.pattern.show_button, *buttons])
            rect = chosen.rect()
            inside = QPoint(rng.randrange(rect.width()), rng.randrange(rect.height()))
            return chosen.mapTo(window, inside)
        return QPoint(rng.randrange(window.width()), rng.randrange(window.height()))


class Watch:
    """The commands that a window sends to its engine, and what the window has read back."""

    def __init__(self, window: MainWindow, connection: EngineConnection) -> None:
        self.window, self.commands = window, list[Command]()
        self._connection, self._send = connection, connection.send
        self._watch(self.send)

    def send(self, command: Command) -> None:
        self.commands.append(command)
        self._send(command)

    def close(self) -> None:
        self._watch(self._send)

    def _watch(self, send: Callable[[Command], None]) -> None:
        self._connection.send = send  # type: ignore[method-assign]
        # These two have taken the method for themselves.
        self.window.session.settings._send = send
        self.window.session._runs._send = send

    @property
    def moves(self) -> list[str]:
        return [type(one).__name__ for one in self.commands if isinstance(one, MOVES)]

    @property
    def seen(self) -> tuple[str, ...]:
        """What the window says of the bench."""
        settings = self.window.settings
        labels = (
            settings.target_read,
            settings.wavelength_read,
            settings.exposure_read,
            self.window.pattern.displayed_label,
        )
        # The sign says that a field shows another value than the bench has.
        return tuple(one.text().removeprefix(f"{DIFFERS_SIGN} ") for one in labels)


def wait(seen: Callable[[], bool], patience: float = _PATIENCE) -> float:
    """Seconds until something is seen; the patience if it never is."""
    began = time.monotonic()
    while not seen() and time.monotonic() - began < patience:
        QTest.qWait(2)
    return time.monotonic() - began


class Settings:
    """Settings that a person means, each made in one of the ways that the window offers."""

    def __init__(self, hand: Hand, rng: random.Random) -> None:
        self._hand, self._rng, self._window = hand, rng, hand.window
        self.last_way = ""

    @property
    def ways(self) -> tuple[Callable[[], Callable[[], bool]], ...]:
        """Each makes a setting, and returns whether the window has read it back."""
        return (
            self._exposure,
            self._wavelength,
            self._arrow,
            self._wheel,
            self._target_by_click,
            self._target_by_keys,
            self._pattern,
        )

    def make(self) -> Callable[[], bool]:
        """Make a setting in one of the ways; return whether the window has read it back."""
        way = self._rng.choice(self.ways)
        self.last_way = way.__name__
        return way()

    def _exposure(self) -> Callable[[], bool]:
        settings, wanted = self._window.settings, self._rng.randint(20, 900)
        self._hand.types(settings.exposure, str(wanted))
        return lambda: settings.exposure_read.text() == f"{wanted}.000 ms"

    def _wavelength(self) -> Callable[[], bool]:
        settings, wanted = self._window.settings, self._rng.randint(430, 710)
        self._hand.types(settings.wavelength, str(wanted))
        return lambda: settings.wavelength_read.text() == f"{wanted}.00 nm"

    def _arrow(self) -> Callable[[], bool]:
        settings = self._window.settings
        field, read = self._rng.choice(
            [
                (settings.wavelength, settings.wavelength_read),
                (settings.exposure, settings.exposure_read),
            ]
        )
        before = read.text()
        self._hand.clicks(field, arrow_place(field, up=self._rng.random() < 0.5))
        return lambda: read.text() != before and read.text() == field.text()

    def _wheel(self) -> Callable[[], bool]:
        settings = self._window.settings
        before, place = settings.exposure_read.text(), settings.exposure.rect().center()
        self._hand.clicks(settings.exposure)
        place = settings.exposure.mapTo(self._window, place)
        self._hand.turns(place, self._rng.choice((-1, 1)), ctrl=True)
        self._hand.presses(Qt.Key.Key_Return)
        read = settings.exposure_read
        return lambda: read.text() != before and read.text() == settings.exposure.text()

    def _target_by_click(self) -> Callable[[], bool]:
        box, view = self._window.settings.target, self._window.settings.target.view()
        row = self._rng.randrange(box.count())
        wanted = box.itemText(row)
        self._hand.clicks(box)
        wait(view.isVisible)
        # Qt takes no click for a choice right after the list has opened.
        QTest.qWait(QApplication.doubleClickInterval() + 50)
        place = view.visualRect(box.model().index(row, 0)).center()
        self._hand.clicks(view.viewport(), place)
        return lambda: self._window.settings.target_read.text() == wanted

    def _target_by_keys(self) -> Callable[[], bool]:
        settings = self._window.settings
        settings.target.setFocus(Qt.FocusReason.TabFocusReason)
        up = settings.target.currentIndex() == settings.target.count() - 1
        wanted = settings.target.itemText(settings.target.currentIndex() + (-1 if up else 1))
        self._hand.presses(Qt.Key.Key_Up if up else Qt.Key.Key_Down)
        self._hand.presses(Qt.Key.Key_Return)
        return lambda: settings.target_read.text() == wanted

    def _pattern(self) -> Callable[[], bool]:
        pattern, grey = self._window.pattern, self._rng.randint(10, 300)
        pattern.form.select_kind("axicon")
        self._hand.types(pattern.form.numbers["axicon", "radius_um"], str(grey))
        self._hand.clicks(pattern.show_button)
        wanted = f"axicon {grey} µm for {self._window.settings.wavelength.set_value:g} nm"
        return lambda: pattern.displayed_label.text() == f"On the SLM: {wanted}"


def arrow_place(field: CommitSpinBox, *, up: bool) -> QPoint:
    option = QStyleOptionSpinBox()
    field.initStyleOption(option)
    control = QStyle.SubControl.SC_SpinBoxUp if up else QStyle.SubControl.SC_SpinBoxDown
    style = field.style()
    return style.subControlRect(QStyle.ComplexControl.CC_SpinBox, option, control, field).center()


def stray_figures(
    hand: Hand, watch: Watch, rng: random.Random, count: int, plan: Path, folder: Path
) -> dict[str, Any]:
    """Make stray gestures while nothing runs, in a paused run, and in one under way."""
    window = hand.window
    before, kinds, moves = watch.seen, dict[str, int](), list[str]()

    def storm(times: int) -> None:
        watch.commands.clear()
        for _ in range(times):
            kind = hand.stray(rng)
            kinds[kind] = kinds.get(kind, 0) + 1
            QTest.qWait(2)
        hand.closes_lists()
        moves.extend(watch.moves)

    storm(count // 3)
    unmoved = watch.seen == before
    for _ in range(2):
        watch.send(RunPlan(plan, folder))
        wait(lambda: window.session.queue.current_run is not None)
    watch.send(PauseRun(True))
    wait(lambda: window.prompt_bar.text.startswith("PAUSED"))
    storm(count // 3)
    watch.send(PauseRun(False))
    wait(lambda: not window.prompt_bar.text)
    storm(count - 2 * (count // 3))
    wait(lambda: not window.session.queue.is_busy, 120)
    queue = window.session.queue
    lost = [run.title for run in queue.runs if run.state.value != "COMPLETE"]
    wait(lambda: watch.seen == before)
    return {
        "stray": kinds,
        "moves": moves,
        "runs": len(queue.runs),
        "lost": len(lost),
        "unmoved": unmoved and watch.seen == before,
    }


def meant_figures(settings: Settings, count: int) -> dict[str, Any]:
    """Make settings that are meant; how many were read back."""
    refused = []
    for _ in range(count):
        seen = settings.make()
        wait(seen)
        if not seen():
            refused.append(settings.last_way)
    return {"meant": count, "obeyed": count - len(refused), "refused": refused}


def undo_figures(hand: Hand, watch: Watch, settings: Settings, count: int) -> dict[str, Any]:
    """Undo each of some random settings; the seconds until the window has read back the old ones.

    A setting that changed nothing is made again.
    """
    seconds = []
    while len(seconds) < count:
        before = watch.seen
        wait(settings.make())
        if watch.seen == before:
            continue
        hand.takes_focus()
        began = time.monotonic()
        hand.presses(Qt.Key.Key_Z, ctrl=True)
        wait(lambda old=before: watch.seen == old)
        seconds.append(time.monotonic() - began)
    return {"undone": len(seconds), "seconds": sorted(seconds)}


def main(arguments: list[str]) -> None:
    bench, scene, plan, folder = map(Path, arguments[:4])
    seed, stray, meant = map(int, arguments[4:])
    _application, window, connection = open_window(bench=bench, scene=scene)
    watch, hand, rng = Watch(window, connection), Hand(window), random.Random(seed)
    wait(window.actions_["live"].isEnabled, 120)
    wait(lambda: "no picture" not in window.live_view.caption.text(), 120)
    wait(lambda: watch.seen[0] == "photograph")
    found = stray_figures(hand, watch, rng, stray, plan, folder)
    window.actions_["reset"].trigger()
    settings = Settings(hand, rng)
    found |= meant_figures(settings, meant)
    found |= undo_figures(hand, watch, settings, meant)
    print(json.dumps(found), flush=True)
    window.close()


if __name__ == "__main__":
    main(sys.argv[1:])
