"""The person's requests to the engine, and which of them are possible now."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from labapp.files.guarded_reading import is_file
from labapp.window.accuracy_view import MEASUREMENT
from labapp.window.alignment_requests import AlignmentRequests
from labapp.window.commands import (
    Cancel,
    CancelJob,
    Command,
    ComputePreview,
    ForecastAccuracy,
    MeasureAccuracy,
    OpenRecord,
    ReconnectDevice,
    ReconstructRun,
    SaveRestored,
    SetLive,
    SetTolerance,
    SetView,
)
from labapp.window.engine_connection import EngineConnection
from labapp.window.frame_reduction import FrameView
from labapp.window.messages import BenchOpened, QueueState, RecordOpened, RequestRefused
from labapp.window.question_bar import Question
from labapp.window.report_display import ReportDisplay
from labapp.window.run_requests import RunRequests
from labapp.window.setting_requests import SettingRequests
from labapp.window.spectral_messages import ListBands, RestoreCube, ShowCubeColours

if TYPE_CHECKING:
    from labapp.window.main_window import MainWindow


_RUN = "run"
"""Subject of the question whether a run or a measurement is cancelled."""

_PICTURE_KINDS = "Light (*.tiff *.npy *.exr *.hdr);;Picture (*.png)"
_CUBE_KINDS = "Cube (*.h5 *.hdr);;Colours (*.png)"
"""Kinds of files for a restored picture, and for a cube, as Qt's dialogues want them."""


class Session(QObject):
    """Turn the panels' signals into commands to the engine, and enable only what is possible.

    job: "reconstruction" or "accuracy" while one is under way, else "".
    queue: the runs.
    first_target: target of the last session, which is placed when the bench opens.
    """

    def __init__(self, window: MainWindow, connection: EngineConnection) -> None:
        super().__init__(window)
        self._window, self._connection = window, connection
        self._reports = ReportDisplay(window, self)
        self._open = False
        self._last_run: Path | None = None
        self._live_before = False
        self.job = ""
        self.queue = QueueState(())
        self.first_target = ""
        self._waiting = False
        self.settings = SettingRequests(window, connection)
        connection.report_received.connect(self._reports.show_report)
        connection.engine_died.connect(self._engine_died)
        self._runs = RunRequests(window, connection)
        self.alignment = AlignmentRequests(window, connection, self.settings)
        self._connect_panels()
        self._connect_actions()
        self._connect_accuracy()
        self._allow()
        window.message.show_message("Opening the bench …")

    @property
    def is_run_active(self) -> bool:
        """Return whether a run is using the bench, or is about to."""
        return self.queue.is_busy

    def on_bench_opened(self, bench: BenchOpened) -> None:
        """Send the chosen settings to a newly opened bench, and start live view."""
        window = self._window
        self._open = True
        window.settings.adopt_bench_ranges(
            bench, window.settings.target.set_text or self.first_target
        )
        self.settings.on_bench_opened(bench)
        self._send_view(window.live_view.view)
        self._connection.send(SetLive(True))
        self.alignment.open_bench(bench)
        window.pattern.schedule_preview()
        self._runs.restore_kept()
        if self._last_run is not None:
            self._connection.send(ListBands(self._last_run))
        self._allow()

    def refuse_request(self, refused: RequestRefused) -> None:
        self._runs.refuse(refused)

    @property
    def last_run(self) -> Path | None:
        """Return the record that F7 reconstructs; None if there is none yet."""
        return self._last_run

    def restore_last_run(self, run: Path) -> None:
        """Take over the last session's run, if its record is still there."""
        if is_file(run):
            self._last_run = run
            self._window.run.show_last_run(run)

    def note_waiting(self, waiting: bool) -> None:
        """Note whether a run waits for the person, who may look and expose."""
        if waiting != self._waiting:
            self._waiting = waiting
            self._allow()

    def on_run_completed(self, run: Path) -> None:
        """Note a complete run's record, so that the person can reconstruct it."""
        self._last_run = run
        self._window.keep_settings()
        self._connection.send(ListBands(run))
        self._allow()

    def on_job_ended(self) -> None:
        """Note that the engine's job is over, and enable the actions again."""
        measured, self.job = self.job == MEASUREMENT, ""
        if measured:
            self._window.question.withdraw(_RUN)
        if measured and self._live_before:
            self._connection.send(SetLive(True))
        self._allow()

    def show_queue(self, queue: QueueState) -> None:
        self.queue = queue
        self._runs.show_queue(queue)
        if not queue.is_busy:
            self._window.question.withdraw(_RUN)
        self._allow()
        self.settings.send_pending_wavelength()

    def _engine_died(self, how: str) -> None:
        self._open = False
        self._runs.forget_engine()
        self.settings.on_bench_closed()
        self._reports.show_engine_death(how)
        self.show_queue(QueueState(()))
        self.on_job_ended()

    def _connect_panels(self) -> None:
        window, send = self._window, self._connection.send
        window.pattern.preview_requested.connect(self._preview)
        window.devices.reconnect_requested.connect(lambda device: send(ReconnectDevice(device)))
        window.message.restart_requested.connect(self._restart)
        window.live_view.view_changed.connect(self._send_view)
        window.live_view.frame_shown.connect(self._connection.acknowledge_frame)
        window.live_view.auto_contrast_changed.connect(window.actions_["contrast"].setChecked)

    def _send_view(self, view: FrameView) -> None:
        """Tell the engine what is shown of live frames, and how often the screen is redrawn."""
        self._connection.send(SetView(view, 1 / max(self._window.screen().refreshRate(), 1.0)))

    def _connect_accuracy(self) -> None:
        view, send = self._window.accuracy, self._connection.send
        view.tolerance_requested.connect(self._set_tolerance)
        view.forecast_requested.connect(self._forecast)
        view.measurement_requested.connect(self._measure)
        view.cancel_requested.connect(lambda job: send(CancelJob(job)))

    def _set_tolerance(self, tol: float | None) -> None:
        """Send the chosen tolerance, and predict the pattern's PSF within it."""
        self._connection.send(SetTolerance(tol))
        self._window.pattern.schedule_preview()

    def _forecast(self) -> None:
        wavelength, exposure = self._window.settings.set_values
        self._connection.send(ForecastAccuracy(wavelength, exposure))

    def _measure(self) -> None:
        """Start the full measurement, while live view rests."""
        window = self._window
        self._live_before = window.actions_["live"].isChecked()
        self._connection.send(SetLive(False))
        self.job = MEASUREMENT
        window.accuracy.start_measurement()
        self._allow()
        self._connection.send(MeasureAccuracy(Path(window.run.folder.text())))

    def _connect_actions(self) -> None:
        actions, view = self._window.actions_, self._window.live_view
        actions["live"].performed.connect(lambda on: self._connection.send(SetLive(on)))
        actions["reconstruct"].performed.connect(self._reconstruct_last)
        restored = self._window.reconstruction
        restored.save_requested.connect(self._save_restored)
        restored.spectra.light_requested.connect(
            lambda light: self._connection.send(ShowCubeColours(light))
        )
        actions["open"].performed.connect(self._open_run)
        actions["cancel"].performed.connect(self._ask_to_cancel)
        actions["lock"].toggled.connect(lambda _: self._allow())
        for name, change in (
            ("contrast", view.set_auto_contrast),
            ("marks", view.set_clipping_marks),
        ):
            actions[name].setChecked(True)
            actions[name].performed.connect(change)

    def _allow(self) -> None:
        """Enable the actions that are possible now, and disable the others."""
        window, free = self._window, self._open and not self.job
        idle = free and not self.is_run_active
        # What is locked neither moves nor begins; a run under way can still be stopped.
        movable = free and not self.settings.is_locked
        may_look = (idle or (self._open and self._waiting)) and not self.settings.is_locked
        # The next run can be prepared and queued while one is under way.
        allowed = {
            "live": may_look,
            "acquire": movable,
            "plan": movable,
            "resume": movable,
            "pause": self._open and self.queue.current_run is not None,
            "cancel": self._open and (self.is_run_active or bool(self.job)),
            "open": idle,
            "reconstruct": idle and self._last_run is not None,
        }
        for name, on in allowed.items():
            window.actions_[name].setEnabled(on)
        window.accuracy.set_measuring_allowed(idle)
        window.pattern.setEnabled(self._open)
        self.settings.allow(self._open, run_active=self.is_run_active, waiting=self._waiting)
        window.devices.set_locked(self.is_run_active or self.settings.is_locked)
        window.alignment.set_allowed(exposes=may_look, proposes=idle and movable)
        window.queue.release_button.setEnabled(movable)

    def _preview(self, table: dict[str, Any]) -> None:
        if self._open:
            wavelength = self._window.settings.wavelength.set_value * 1e-9
            self._connection.send(ComputePreview(table, wavelength))

    def _reconstruct_last(self) -> None:
        if self._last_run is not None:
            self._reconstruct(self._last_run)

    def _open_run(self) -> None:
        folder = self._window.run.folder.text()
        path, _ = QFileDialog.getOpenFileName(self._window, "Run", folder, "Runs (*.h5)")
        if path:
            self._last_run = Path(path)
            self._connection.send(ListBands(self._last_run))
            self._connection.send(OpenRecord(self._last_run))
            self._allow()

    def show_record(self, record: RecordOpened) -> None:
        """Show a record that the person has opened, and restore it if it can be."""
        window = self._window
        window.reconstruction.show_record(record)
        window.show_reconstruction()
        window.message.show_message(f"Opened {record.path}.")
        wants_bands = window.reconstruction.wanted_bands is not None
        if self._last_run == record.path and (wants_bands or not record.why_not_restored):
            self._reconstruct_last()

    def _save_restored(self) -> None:
        title, ending, kinds = "Reconstructed picture", ".tiff", _PICTURE_KINDS
        if self._window.reconstruction.shows_cube:
            title, ending, kinds = "Spectral cube", "_cube.h5", _CUBE_KINDS
        run = self._last_run
        first = "" if run is None else str(run.with_name(f"{run.stem}{ending}"))
        path, _ = QFileDialog.getSaveFileName(self._window, title, first, kinds)
        if path:
            self._connection.send(SaveRestored(Path(path)))

    def _reconstruct(self, path: Path) -> None:
        self.job, self._last_run = "reconstruction", path
        self._window.run.show_start("reconstructing …")
        self._window.show_reconstruction()
        self._allow()
        self._connection.send(ListBands(path))
        self._connection.send(self._restoration_of(path))

    def _restoration_of(self, path: Path) -> Command:
        """Return the command that restores a record as the person has chosen."""
        view = self._window.reconstruction
        if (bands := view.wanted_bands) is not None:
            return RestoreCube(path, bands, view.spectra.light.currentText())
        return ReconstructRun(path, *view.choices)

    def _ask_to_cancel(self) -> None:
        """Ask before a run or a measurement is given up; end other jobs at once.

        What an hour took isn't lost to one key. A second Esc says no.
        """
        question, run = self._window.question, self.queue.current_run
        if question.subject:
            question.decline()
        elif self.is_run_active or self.job == MEASUREMENT:
            text = "Cancel the measurement? What it has measured is kept."
            if run is not None:
                text = (
                    f"Cancel {run.title}? {run.stored_frames} of {run.planned_frames} frames are "
                    "stored and kept; the rest can be taken later (Ctrl+R)."
                )
            elif self.is_run_active:
                text = "Cancel the run that is about to begin?"
            question.ask(Question(_RUN, text, "Cancel it", "Go on", self._cancel))
        else:
            self._cancel()

    def _cancel(self) -> None:
        self._window.run.message.setText("cancelling …")
        self._connection.send(Cancel())

    def _restart(self) -> None:
        self._window.message.clear_engine_failure()
        self._window.message.show_message("Opening the bench …")
        self._window.devices.clear("opening the bench …")
        self._connection.start()
