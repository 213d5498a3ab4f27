"""What the person asks of the engine, and what can be asked now."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from labapp.window.connection import Connection
from labapp.window.messages import (
    Acquire,
    BenchOpened,
    Cancel,
    Expose,
    Place,
    Preview,
    Reconstruct,
    SetLive,
    Show,
    Tune,
)
from labapp.window.reports import Reports

if TYPE_CHECKING:
    from labapp.window.main_window import MainWindow


class Session(QObject):
    """Panels' signals become commands, and only what can be done can be clicked.

    job: "run" or "reconstruction" while one is under way, else "". first_target: the
    target of the last session, for when the bench opens.
    """

    def __init__(self, window: MainWindow, connection: Connection) -> None:
        super().__init__(window)
        self._window, self._connection = window, connection
        self._reports = Reports(window, self)
        self._open = False
        self._last_run: Path | None = None
        self.job = ""
        self.first_target = ""
        connection.received.connect(self._reports.show)
        connection.died.connect(self._engine_died)
        self._connect_panels()
        self._connect_actions()
        self._allow()
        window.message.say("Opening the bench …")

    @property
    def in_run(self) -> bool:
        return self.job == "run"

    def opened(self, bench: BenchOpened) -> None:
        """A bench has opened, and knows nothing of what the person wants."""
        window = self._window
        self._open = True
        window.settings.fit_to(bench, window.settings.target.currentText() or self.first_target)
        window.settings.ask_for_all()
        self._connection.send(SetLive(True))
        window.pattern.refresh()
        self._allow()

    def completed(self, run: Path) -> None:
        """There is a run that can be reconstructed."""
        self._last_run = run
        self._allow()

    def finish(self) -> None:
        """The job is over."""
        self.job = ""
        self._allow()

    def _engine_died(self, how: str) -> None:
        self._open = False
        self.finish()
        self._reports.show_death(how)

    def _connect_panels(self) -> None:
        window, send = self._window, self._connection.send
        window.settings.target_asked.connect(lambda name: send(Place(name)))
        window.settings.wavelength_asked.connect(self._tune)
        window.settings.exposure_asked.connect(lambda seconds: send(Expose(seconds)))
        window.pattern.preview_asked.connect(self._preview)
        window.pattern.show_asked.connect(lambda table: send(Show(table)))
        window.message.restart_asked.connect(self._restart)
        window.live_view.auto_changed.connect(window.actions_["contrast"].setChecked)

    def _connect_actions(self) -> None:
        actions, view = self._window.actions_, self._window.live_view
        actions["live"].triggered.connect(lambda on: self._connection.send(SetLive(on)))
        actions["acquire"].triggered.connect(self._acquire)
        actions["reconstruct"].triggered.connect(self._reconstruct_last)
        actions["open"].triggered.connect(self._open_run)
        actions["cancel"].triggered.connect(self._cancel)
        for name, change in (("contrast", view.set_auto), ("marks", view.set_marked)):
            actions[name].setChecked(True)
            actions[name].triggered.connect(change)

    def _allow(self) -> None:
        window, idle = self._window, self._open and not self.job
        for name in ("live", "acquire", "open"):
            window.actions_[name].setEnabled(idle)
        window.actions_["reconstruct"].setEnabled(idle and self._last_run is not None)
        window.actions_["cancel"].setEnabled(self._open and bool(self.job))
        free = self._open and not self.in_run
        window.settings.setEnabled(free)
        window.pattern.setEnabled(free)
        for row in (window.run.star, window.run.photograph):
            row.set_enabled(not self.in_run)

    def _tune(self, wavelength: float) -> None:
        self._connection.send(Tune(wavelength))
        self._window.pattern.set_wavelength(self._window.settings.wavelength.value())

    def _preview(self, table: dict[str, Any]) -> None:
        if self._open:
            wavelength = self._window.settings.wavelength.value() * 1e-9
            self._connection.send(Preview(table, wavelength))

    def _acquire(self) -> None:
        window = self._window
        path = window.run.new_path(datetime.now())
        self._begin("run", "starting the run …")
        window.message.say(f"Taking the bracket into {path} …")
        window.tabs.setCurrentWidget(window.live_view)
        self._connection.send(
            Acquire(
                pattern=window.pattern.table(),
                wavelength=window.settings.wavelength.value() * 1e-9,
                star=window.run.star.bracket,
                photograph=window.run.photograph.bracket,
                path=path,
            )
        )

    def _reconstruct_last(self) -> None:
        if self._last_run is not None:
            self._reconstruct(self._last_run)

    def _open_run(self) -> None:
        folder = self._window.run.folder.text()
        path, _ = QFileDialog.getOpenFileName(self._window, "Run", folder, "Runs (*.h5)")
        if path:
            self._reconstruct(Path(path))

    def _reconstruct(self, path: Path) -> None:
        self._begin("reconstruction", "reconstructing …")
        self._connection.send(Reconstruct(path))

    def _cancel(self) -> None:
        self._window.run.message.setText("cancelling …")
        self._connection.send(Cancel())

    def _restart(self) -> None:
        self._window.message.engine_is_back()
        self._window.message.say("Opening the bench …")
        self._window.devices.clear("opening the bench …")
        self._connection.start()

    def _begin(self, job: str, message: str) -> None:
        self.job = job
        self._window.run.begin(message)
        self._allow()
