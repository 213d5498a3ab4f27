"""Requests for settings of the bench: set, undo, redo, and lock them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject

from labapp.window.commands import (
    AskForTarget,
    PlaceTarget,
    SetExposure,
    SetWavelength,
    ShowPattern,
    ShowPatternAgain,
)
from labapp.window.engine_connection import EngineConnection
from labapp.window.messages import BenchOpened, BenchState
from labapp.window.question_bar import Question
from labapp.window.settings_history import SettingChange, SettingsHistory

if TYPE_CHECKING:
    from labapp.window.main_window import MainWindow

_DOUBT = "doubt"
"""Subject of the question about a target that the picture doesn't show."""

_TARGET = "target"
"""Subject of the question whether a person has placed a target."""


class SettingRequests(QObject):
    """Send the person's settings to the engine, and undo and redo them.

    Undo sends the value that was set before. A target that a person places is asked for first, and
    it is sent once the person has confirmed it. While a run is active, nothing is sent but a
    wavelength for what follows, which waits until live view runs again.
    """

    def __init__(self, window: MainWindow, connection: EngineConnection) -> None:
        super().__init__(window)
        self._window, self._send = window, connection.send
        self._history = SettingsHistory()
        self._by_hand = self._run_active = self._waiting = self._open = False
        self._wavelength_pending = False
        self._newest_pattern = 0
        self._target_doubt = ""
        settings, actions = window.settings, window.actions_
        settings.target_requested.connect(self._request_target)
        settings.wavelength_requested.connect(self._request_wavelength)
        settings.exposure_requested.connect(lambda seconds: self._set("exposure", seconds))
        window.pattern.show_requested.connect(lambda table: self._send(ShowPattern(table)))
        actions["undo"].performed.connect(self._undo)
        actions["redo"].performed.connect(self._redo)

    @property
    def is_locked(self) -> bool:
        """Return whether the person has locked the settings."""
        return self._window.actions_["lock"].isChecked()

    def on_bench_opened(self, bench: BenchOpened) -> None:
        """Begin with a bench that has just opened, and request all settings from it."""
        self._by_hand = bench.targets_by_hand
        self._newest_pattern = 0
        self._target_doubt = ""
        self._history.clear()
        self._history.note("pattern", 0)
        self._window.settings.request_all_settings()

    def on_bench_closed(self) -> None:
        """Forget what was set on a bench that is lost."""
        for subject in (_TARGET, _DOUBT):
            self._window.question.withdraw(subject)
        self._history.clear()

    def show_state(self, state: BenchState) -> None:
        """Note a new pattern on the SLM, and send what waits for live view.

        A pattern counts once it is shown, since it may take a while to compute.
        """
        if state.pattern_number > self._newest_pattern:
            self._newest_pattern = state.pattern_number
            self._history.note("pattern", state.pattern_number)
        if self._by_hand and state.target and not self._run_active:
            # A run may have asked for another target than the window did last.
            self._history.values["target"] = state.target
        if state.target_doubt != self._target_doubt:
            self._target_doubt = state.target_doubt
            self._ask_about_target(state.target)
        self.send_pending_wavelength()
        self._update()

    def _ask_about_target(self, target: str) -> None:
        """Ask if a target is in place that the picture doesn't show; if not, to place it again."""
        if not self._target_doubt or self._run_active:
            return
        self._window.question.ask(
            Question(
                _DOUBT,
                f"{target!r} is confirmed, but {self._target_doubt}.",
                "It is in place",
                "Place it again",
                lambda: None,
                lambda: self._request_target(target),
            )
        )

    def allow(self, is_open: bool, *, run_active: bool, waiting: bool) -> None:
        """Enable the settings that may be changed now, and disable the others.

        waiting: whether a run waits for the person, who may expose meanwhile.
        """
        self._open, self._run_active, self._waiting = is_open, run_active, waiting
        window, free = self._window, is_open and not self.is_locked
        if run_active or not free:
            for subject in (_TARGET, _DOUBT):
                window.question.withdraw(subject)
            self._end_asking()
        window.settings.set_enabled(free, run_active=run_active, waiting=waiting)
        window.pattern.set_showing_allowed(free and not run_active)
        window.actions_["lock"].setEnabled(is_open)
        for name, change in (
            ("undo", self._history.next_undo),
            ("redo", self._history.next_redo),
        ):
            action = window.actions_[name]
            action.setEnabled(free and not run_active and change is not None)
            action.setToolTip(_describe(name, change))

    def note_exposure(self, exposure: float) -> None:
        """Show and note an exposure in seconds that the engine has found and set."""
        self._show("exposure", exposure)
        self._history.note("exposure", exposure)
        self._update()

    def send_pending_wavelength(self) -> None:
        """Send the wavelength chosen during a run, once live view runs again."""
        if (
            self._wavelength_pending
            and not self._run_active
            and self._window.actions_["live"].isChecked()
        ):
            self._wavelength_pending = False
            self._set("wavelength", self._window.settings.wavelength.set_value * 1e-9)

    def _request_wavelength(self, wavelength: float) -> None:
        window = self._window
        window.pattern.set_wavelength(window.settings.wavelength.set_value)
        window.accuracy.make_outdated()
        if self._run_active:
            self._wavelength_pending = True
        else:
            self._set("wavelength", wavelength)

    def _request_target(self, target: str) -> None:
        """Place a target, or ask a person to place it."""
        if self._by_hand:
            self._ask_to_place(target, lambda: self._set("target", target))
        else:
            self._set("target", target)

    def _ask_to_place(self, target: str, confirm: Callable[[], None]) -> None:
        """Ask the person to place a target; `confirm` is called once it stands."""
        settings = self._window.settings

        def end() -> None:
            settings.ask_for_target("")
            confirm()

        self._window.question.ask(
            Question(
                _TARGET,
                f"Place the target {target!r} before the camera, then confirm it.",
                "It is in place",
                "Not now",
                end,
                self._end_asking,
            )
        )
        settings.ask_for_target(target)
        self._send(AskForTarget(target))

    def _end_asking(self) -> None:
        """End the request for a target that the person hasn't placed."""
        settings = self._window.settings
        if settings.asked_target:
            settings.target.show_text(self._history.values.get("target", ""))
            settings.ask_for_target("")
            self._send(AskForTarget(""))

    def _set(self, name: str, value: Any) -> None:
        """Send a setting, and note it for undo."""
        self._history.note(name, value)
        self._send_value(name, value)
        self._update()

    def _undo(self) -> None:
        if (change := self._history.next_undo) is not None:
            self._step(change, change.before, self._history.undo)

    def _redo(self) -> None:
        if (change := self._history.next_redo) is not None:
            self._step(change, change.after, self._history.redo)

    def _step(self, change: SettingChange, value: Any, step: Callable[[], object]) -> None:
        """Send the value that a setting had before or after a change, and note the step.

        A target that a person places is moved by the person, and noted once it stands.
        """
        self._show(change.name, value)
        if change.name == "target" and self._by_hand:
            self._ask_to_place(value, lambda: self._confirm_step(change, value, step))
            return
        step()
        self._send_value(change.name, value)
        self._update()

    def _confirm_step(self, change: SettingChange, value: str, step: Callable[[], object]) -> None:
        """Note that a person has placed the target that undo or redo asked for."""
        if change in (self._history.next_undo, self._history.next_redo):
            step()
            self._send_value("target", value)
            self._update()
        else:
            self._set("target", value)

    def _update(self) -> None:
        self.allow(self._open, run_active=self._run_active, waiting=self._waiting)

    def _show(self, name: str, value: Any) -> None:
        """Show the value of a setting in its field; a pattern has none."""
        window = self._window
        if name == "exposure":
            window.settings.exposure.show_value(value * 1e3)
        elif name == "target":
            window.settings.target.show_text(value)
        elif name == "wavelength":
            window.settings.wavelength.show_value(value * 1e9)
            window.pattern.set_wavelength(window.settings.wavelength.set_value)
            window.accuracy.make_outdated()

    def _send_value(self, name: str, value: Any) -> None:
        if name == "exposure":
            self._send(SetExposure(value))
        elif name == "wavelength":
            self._send(SetWavelength(value))
        elif name == "target":
            self._send(PlaceTarget(value))
        else:
            self._send(ShowPatternAgain(value))


def _describe(name: str, change: SettingChange | None) -> str:
    """Describe what undo or redo would do, by the action's name."""
    key = {"undo": "(Ctrl+Z)", "redo": "(Ctrl+Y)"}[name]
    if change is None:
        return f"Nothing to {name}  {key}"
    value = change.before if name == "undo" else change.after
    if change.name == "pattern":
        return f"{name.capitalize()} the last pattern on the SLM  {key}"
    shown = {"exposure": 1e3, "wavelength": 1e9}.get(change.name)
    unit = {"exposure": " ms", "wavelength": " nm"}.get(change.name, "")
    text = f"{value * shown:g}{unit}" if shown else str(value)
    return f"{name.capitalize()}: {change.name} {text}  {key}"
