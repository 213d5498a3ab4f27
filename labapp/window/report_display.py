"""Display of the engine's reports on the panels."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labapp.runs.state import State
from labapp.window.accuracy_view import MEASUREMENT
from labapp.window.device_list import DEVICE_TITLES
from labapp.window.measuring_messages import (
    BracketProposal,
    ExposureFound,
    PictureMeasured,
    StarFound,
)
from labapp.window.messages import (
    AccuracyForecast,
    AccuracyMeasured,
    BenchOpened,
    BenchState,
    CancelAcknowledged,
    DeviceReconnected,
    EffectsReport,
    FailureReport,
    JobEnded,
    JobProgress,
    LivePicture,
    OpeningFailed,
    PatternPreview,
    PictureAwaited,
    PictureSaved,
    QueueState,
    ReconstructionResult,
    RecordOpened,
    RequestRefused,
    RunEnded,
)
from labapp.window.spectral_messages import CubeColours, RecordBands, SpectralResult
from labapp.window.tone_mapping import DigitalScale

if TYPE_CHECKING:
    from labapp.window.main_window import MainWindow
    from labapp.window.session import Session

_HINT = (
    "First steps: choose a pattern and show it on the SLM, acquire a bracket (F6), "
    "then reconstruct (F7)."
)


class ReportDisplay:
    """Show each kind of report from the engine with one method, and inform `session` of it."""

    def __init__(self, window: MainWindow, session: Session) -> None:
        self._window, self._session = window, session
        self._why_not_open = ""
        self._under_way = 0
        self._show: dict[type, Callable[[Any], None]] = {
            BenchOpened: self._bench_opened,
            BenchState: self._bench_state,
            LivePicture: window.live_view.show_picture,
            PictureAwaited: window.live_view.show_awaited,
            EffectsReport: window.effects.show_effects,
            PatternPreview: window.pattern.show_preview,
            JobProgress: self._job_progress,
            JobEnded: self._job_ended,
            CancelAcknowledged: lambda _: window.run.message.setText("cancelling …"),
            QueueState: self._queue_state,
            RequestRefused: session.refuse_request,
            DeviceReconnected: self._device_reconnected,
            RunEnded: self._run_ended,
            RecordOpened: session.show_record,
            ReconstructionResult: self._reconstruction_result,
            SpectralResult: self._spectral_result,
            CubeColours: window.reconstruction.spectra.show_colours,
            RecordBands: window.reconstruction.show_bands,
            AccuracyForecast: window.accuracy.show_forecast,
            AccuracyMeasured: self._accuracy_measured,
            PictureSaved: lambda report: window.message.show_message(f"Saved: {report.path}."),
            PictureMeasured: lambda report: session.alignment.show_measured(report),
            StarFound: lambda report: session.alignment.show_star(report),
            ExposureFound: lambda report: session.alignment.show_exposure(report),
            BracketProposal: window.alignment.show_proposal,
            FailureReport: lambda report: window.message.show_error(report.message),
            OpeningFailed: self._opening_failed,
        }

    def show_report(self, report: object) -> None:
        """Show a report where it belongs."""
        self._show[type(report)](report)

    def show_engine_death(self, how: str) -> None:
        """Show that the engine ended by itself; clear what is no longer known."""
        window = self._window
        window.bar.badge.show_bench_closed()
        window.settings.clear_read_back()
        window.pattern.show_displayed("unknown, the engine is gone")
        window.actions_["live"].setChecked(False)
        window.live_view.set_live(False)
        window.run.show_end("", done=False)
        window.devices.clear("the engine is not running")
        window.effects.clear("The engine is not running.")
        window.accuracy.close_bench()
        window.queue.show_queue(QueueState(()))
        window.prompt_bar.show_queue(QueueState(()))
        window.message.show_error(self._why_dead(how), restart=True)
        self._why_not_open = ""

    def _why_dead(self, how: str) -> str:
        if self._why_not_open:
            return f"The bench didn't open. {self._why_not_open}"
        queue = self._session.queue
        text = f"{how} Frames that were stored are safe."
        lost = [run for run in queue.runs if not run.state.has_ended]
        if lost:
            runs = "1 run comes" if len(lost) == 1 else f"{len(lost)} runs come"
            return f"{text} Restart the engine: {runs} back in line, and none begins by itself."
        return f"{text} Restart the engine to go on."

    def _bench_opened(self, report: BenchOpened) -> None:
        window = self._window
        window.setWindowTitle(f"labapp – {report.name}")
        window.bar.badge.show_devices(report.devices)
        window.devices.show_devices(report.devices)
        window.effects.show_bench(report.devices)
        window.live_view.set_scale(DigitalScale(report.full_scale))
        window.live_view.picture.set_frame_shape(report.camera_shape)
        window.run.set_frame_shape(report.camera_shape)
        window.run.times.set_virtual(report.virtual)
        window.accuracy.open_bench(report.scene_tolerance)
        window.message.show_message(_HINT)
        self._session.on_bench_opened(report)

    def _bench_state(self, report: BenchState) -> None:
        window = self._window
        window.devices.show_devices(report.devices)
        window.settings.show_state(report)
        window.pattern.show_displayed(
            report.pattern + (" ?" if "slm" in report.failed_devices else "")
        )
        window.actions_["live"].setChecked(report.live)
        window.live_view.set_live(report.live, in_run=report.in_run and not report.waiting)
        self._session.note_waiting(report.waiting)
        self._session.settings.show_state(report)

    def _job_progress(self, report: JobProgress) -> None:
        if report.job == "reconstruction":
            self._window.run.show_progress(report)
        self._window.accuracy.show_progress(report)
        self._session.alignment.show_progress(report)

    def _job_ended(self, report: JobEnded) -> None:
        if report.job == "preview":
            self._window.pattern.show_no_preview()
        self._window.accuracy.show_job_end(report.job)
        self._session.alignment.show_job_end(report)
        if report.job == self._session.job:
            self._session.on_job_ended()
            if report.job != MEASUREMENT:
                self._window.run.show_end("", done=False)

    def _queue_state(self, report: QueueState) -> None:
        window = self._window
        if report.hold_reason and not self._session.queue.hold_reason:
            window.show_queue()
        window.queue.show_queue(report)
        window.prompt_bar.show_queue(report)
        ended = [run for run in report.runs if run.state.has_ended]
        if (run := report.current_run) is not None:
            window.run.show_run(run)
            if run.number != self._under_way:
                self._under_way = run.number
                window.message.show_message(f"{run.title}: taken into {run.path} …")
        elif ended and not self._session.job:
            window.run.show_run(ended[-1])
        self._session.show_queue(report)

    def _run_ended(self, report: RunEnded) -> None:
        window = self._window
        if report.path is not None:
            window.run.show_last_run(report.path)
        if report.state is State.COMPLETE and report.path is not None:
            self._session.on_run_completed(report.path)
            window.message.show_message(
                f"The run is complete: {report.path}. Reconstruct it with F7."
            )
        elif report.state is State.CANCELLED:
            window.message.show_message(f"The run was cancelled. {_rest(report)}")
        else:
            window.message.show_error(f"The run failed: {report.message}. {_rest(report)}")

    def _device_reconnected(self, report: DeviceReconnected) -> None:
        name = DEVICE_TITLES.get(report.device, report.device)
        self._window.message.show_message(f"{name} is open again. Live view starts with F5.")

    def _reconstruction_result(self, report: ReconstructionResult) -> None:
        """Show a reconstruction's result, and bring its tab to the front."""
        window = self._window
        window.reconstruction.show_result(report)
        window.side_by_side.show_result(report)
        self._end_reconstruction(report.path)

    def _spectral_result(self, report: SpectralResult) -> None:
        """Show a restored cube, and bring its tab to the front."""
        window = self._window
        window.reconstruction.show_cube(report)
        # A cube has no pictures side by side.
        window.tabs.setCurrentWidget(window.reconstruction)
        self._end_reconstruction(report.path)

    def _end_reconstruction(self, path: Path) -> None:
        """Say that a record's reconstruction is shown."""
        window = self._window
        self._session.on_job_ended()
        window.run.show_end("reconstructed", done=True)
        window.show_reconstruction()
        window.message.show_message(f"Reconstructed from {path}.")

    def _accuracy_measured(self, report: AccuracyMeasured) -> None:
        self._window.accuracy.show_measured(report)
        self._window.message.show_message(f"Wrote {report.page}.")

    def _opening_failed(self, report: OpeningFailed) -> None:
        self._why_not_open = report.message


def _rest(report: RunEnded) -> str:
    """Describe what an incomplete run left on disk, and the bench's state."""
    if report.path is None:
        return "Nothing was moved or written."
    return (
        f"{report.missing_frames} frames are missing in {report.path}: resume it with Ctrl+R. "
        "The bench is safe; live view starts again with F5."
    )
