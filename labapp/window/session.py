"""What the person asks of the engine, and what can be asked now."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from labapp.window.connection import Connection
from labapp.window.messages import (
    BenchOpened,
    Cancel,
    Expose,
    Place,
    Preview,
    QueueState,
    Reconnect,
    Reconstruct,
    SaveRestored,
    SetLive,
    Show,
    Tune,
)
from labapp.window.reports import Reports
from labapp.window.run_requests import RunRequests

if TYPE_CHECKING:
    from labapp.window.main_window import MainWindow


class Session(QObject):
    """Panels' signals become commands, and only what can be done can be clicked.

    job: "reconstruction" while one is under way, else "". queue: the
    runs. first_target: the target of the last session, for when the bench opens.
    """

    def __init__(self, window: MainWindow, connection: Connection) -> None:
        super().__init__(window)
        self._window, self._connection = window, connection
        self._reports = Reports(window, self)
        self._open = False
        self._last_run: Path | None = None
        self._untold = False
        self.job = ""
        self.queue = QueueState(())
        self.first_target = ""
        connection.received.connect(self._reports.show)
        connection.died.connect(self._engine_died)
        self._runs = RunRequests(window, connection)
        self._connect_panels()
        self._connect_actions()
        self._allow()
        window.message.say("Opening the bench …")

    @property
    def in_run(self) -> bool:
        """Whether a run has the bench, or is about to."""
        return self.queue.busy

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

    def show_queue(self, queue: QueueState) -> None:
        self.queue = queue
        self._runs.show_queue(queue)
        self.tell_wavelength()
        self._allow()

    def _engine_died(self, how: str) -> None:
        self._open = False
        self._reports.show_death(how)
        self.show_queue(QueueState(()))
        self.finish()

    def _connect_panels(self) -> None:
        window, send = self._window, self._connection.send
        window.settings.target_asked.connect(lambda name: send(Place(name)))
        window.settings.wavelength_asked.connect(self._tune)
        window.settings.exposure_asked.connect(lambda seconds: send(Expose(seconds)))
        window.pattern.preview_asked.connect(self._preview)
        window.pattern.show_asked.connect(lambda table: send(Show(table)))
        window.devices.reconnect_asked.connect(lambda device: send(Reconnect(device)))
        window.message.restart_asked.connect(self._restart)
        window.live_view.auto_changed.connect(window.actions_["contrast"].setChecked)

    def _connect_actions(self) -> None:
        actions, view = self._window.actions_, self._window.live_view
        actions["live"].triggered.connect(lambda on: self._connection.send(SetLive(on)))
        actions["reconstruct"].triggered.connect(self._reconstruct_last)
        self._window.reconstruction.save_asked.connect(self._save_restored)
        actions["open"].triggered.connect(self._open_run)
        actions["cancel"].triggered.connect(self._cancel)
        for name, change in (("contrast", view.set_auto), ("marks", view.set_marked)):
            actions[name].setChecked(True)
            actions[name].triggered.connect(change)

    def _allow(self) -> None:
        window, free = self._window, self._open and not self.job
        idle = free and not self.in_run
        # The next run can be prepared and put in line while one is under way.
        allowed = {
            "live": idle,
            "acquire": free,
            "plan": free,
            "resume": free,
            "pause": self._open and self.queue.under_way is not None,
            "cancel": self._open and (self.in_run or bool(self.job)),
            "open": idle,
            "reconstruct": idle and self._last_run is not None,
        }
        for name, on in allowed.items():
            window.actions_[name].setEnabled(on)
        window.settings.setEnabled(self._open)
        window.pattern.setEnabled(self._open)
        for panel in (window.settings, window.pattern, window.devices):
            panel.set_in_run(self.in_run)
        window.queue.go_on.setEnabled(free)

    def _tune(self, wavelength: float) -> None:
        self._window.pattern.set_wavelength(self._window.settings.wavelength.value())
        if self.in_run:
            self._untold = True
        else:
            self._connection.send(Tune(wavelength))

    def tell_wavelength(self) -> None:
        """What was chosen for a bracket during a run holds for the live view after it, too."""
        if self._untold and not self.in_run and self._window.actions_["live"].isChecked():
            self._untold = False
            self._connection.send(Tune(self._window.settings.wavelength.value() * 1e-9))

    def _preview(self, table: dict[str, Any]) -> None:
        if self._open:
            wavelength = self._window.settings.wavelength.value() * 1e-9
            self._connection.send(Preview(table, wavelength))

    def _reconstruct_last(self) -> None:
        if self._last_run is not None:
            self._reconstruct(self._last_run)

    def _open_run(self) -> None:
        folder = self._window.run.folder.text()
        path, _ = QFileDialog.getOpenFileName(self._window, "Run", folder, "Runs (*.h5)")
        if path:
            self._reconstruct(Path(path))

    def _save_restored(self) -> None:
        first = "" if self._last_run is None else str(self._last_run.with_suffix(".tiff"))
        kinds = "Light (*.tiff *.npy);;Picture (*.png)"
        path, _ = QFileDialog.getSaveFileName(self._window, "Reconstructed picture", first, kinds)
        if path:
            self._connection.send(SaveRestored(Path(path)))

    def _reconstruct(self, path: Path) -> None:
        self.job, self._last_run = "reconstruction", path
        self._window.run.begin("reconstructing …")
        self._window.show_reconstruction()
        self._allow()
        self._connection.send(Reconstruct(path, *self._window.reconstruction.chosen))

    def _cancel(self) -> None:
        self._window.run.message.setText("cancelling …")
        self._connection.send(Cancel())

    def _restart(self) -> None:
        self._window.message.engine_is_back()
        self._window.message.say("Opening the bench …")
        self._window.devices.clear("opening the bench …")
        self._connection.start()
