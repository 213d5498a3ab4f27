"""The main loop, which handles commands and takes live frames in turn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.errors import DeviceError
from labapp.bench.opening import Bench
from labapp.common.errors import UserError
from labapp.runs.state import State
from labapp.window.commands import (
    AcknowledgeFrame,
    AcquireBracket,
    AnswerPrompt,
    AskForTarget,
    Cancel,
    CancelJob,
    ClearEndedRuns,
    ComputePreview,
    ForecastAccuracy,
    MeasureAccuracy,
    OpenRecord,
    PauseRun,
    PlaceTarget,
    ReconnectDevice,
    ReconstructRun,
    ReleaseQueue,
    RemoveRuns,
    RestoreQueue,
    ResumeRun,
    RunPlan,
    RunRequest,
    SaveRestored,
    SetExposure,
    SetLive,
    SetTolerance,
    SetView,
    SetWavelength,
    ShowPattern,
    ShowPatternAgain,
)
from labapp.window.engine.acquisition import Acquisition
from labapp.window.engine.alignment import Alignment
from labapp.window.engine.awaited_picture import AwaitedPicture
from labapp.window.engine.background_jobs import BackgroundJobs, ComputedPattern
from labapp.window.engine.bench_controller import BenchController
from labapp.window.engine.change_notifier import ChangeNotifier
from labapp.window.engine.channel import Channel
from labapp.window.engine.coarse_prediction import CoarsePrediction
from labapp.window.engine.effects_reporter import EffectsReporter
from labapp.window.engine.failures import describe_failure
from labapp.window.engine.frame_pacer import FramePacer
from labapp.window.engine.frame_sender import FrameSender
from labapp.window.engine.jobs import Jobs
from labapp.window.engine.outdated_frame import OutdatedFrame
from labapp.window.engine.person_prompter import PersonPrompter
from labapp.window.engine.picture_forecast import PictureForecast
from labapp.window.engine.planner import RunPlanner
from labapp.window.engine.queued_run import QueuedRun
from labapp.window.engine.run_queue import RunQueue
from labapp.window.engine.waiting_view import WaitingView
from labapp.window.measuring_messages import FindExposure
from labapp.window.messages import (
    CancelAcknowledged,
    DeviceReconnected,
    LiveFrame,
    QueueState,
    RequestRefused,
)
from labapp.window.spectral_messages import ListBands, RestoreCube, ShowCubeColours
from labapp.window.tone_mapping import DigitalScale

_SETTINGS = (PlaceTarget, SetWavelength, SetExposure, ShowPattern, ShowPatternAgain)
"""Commands after which pictures are others than before."""

_COMPUTING = "computing the picture"


class StartQueuedRuns:
    """Tell the loop, from within the engine, that the next run of the queue may begin."""


class Engine:
    """Own the bench in the main thread; only this loop and its runs set the devices.

    Commands that can't wait for the end of a run are handled at once, in the channel's thread.
    """

    def __init__(self, bench: Bench, channel: Channel) -> None:
        self._channel = channel
        notifier = ChangeNotifier(self._tell_queue)
        self._person = PersonPrompter(notifier.notify)
        self._queue = RunQueue(notifier.notify)
        self._planner = RunPlanner(
            bench,
            self._queue,
            on_failure=self._refuse,
            on_ready=lambda: channel.post(StartQueuedRuns()),
        )
        self._controller = BenchController(bench)
        self._jobs = Jobs(channel)
        self._awaited = AwaitedPicture(channel)
        self._jobs.on_progress = self._awaited.note_job
        tolerance, world = self._controller.live_tolerance, bench.camera_world
        self._outdated = OutdatedFrame(channel, tolerance, world)
        self._forecast = None if world is None else PictureForecast(world)
        self._prediction: CoarsePrediction | None = None
        self._sender = FrameSender(channel, DigitalScale(bench.description.sensor.full_scale))
        self._sender.on_room, self._sender.on_failure = channel.wake, self._complain
        if world is not None:
            self._prediction = CoarsePrediction(world, self._sender.offer_prediction)
        self._pace = FramePacer(self._sender)
        self._background = BackgroundJobs(bench, channel, self._jobs, self._controller)
        self._effects = EffectsReporter(bench, channel)
        self._alignment = Alignment(bench, channel, self._sender, self._controller, self._jobs)
        waiting = WaitingView(
            bench,
            channel,
            self._sender,
            self._controller,
            self._pace,
            {FindExposure: self._alignment.by_bench[FindExposure]},
            self._alignment.offer,
            self._complain,
        )
        self._alignment.is_given_up = lambda: waiting.is_over
        self._acquisition = Acquisition(
            channel,
            self._controller,
            self._sender,
            self._pace,
            self._person,
            self._effects,
            waiting,
            self._alignment.keep_shown,
        )
        self._live = self._live_again = False
        self._obey: dict[type, Callable[[Any], None]] = {
            SetLive: self._set_live,
            PlaceTarget: lambda command: self._controller.place_target(command.target),
            SetWavelength: lambda command: self._controller.set_wavelength(command.wavelength),
            SetExposure: lambda command: self._controller.set_exposure(command.exposure),
            ComputedPattern: lambda command: self._controller.show_pattern(
                command.name, command.grey
            ),
            ShowPatternAgain: lambda command: self._controller.show_again(command.number),
            AskForTarget: lambda command: self._controller.ask_for_target(command.target),
            ReconnectDevice: self._reconnect,
            StartQueuedRuns: self._run_all,
            **self._alignment.by_bench,
        }
        at_once: dict[type, Callable[[Any], None]] = {
            SetView: self._set_view,
            AcknowledgeFrame: self._sender.acknowledge,
            ShowPattern: self._background.compute_pattern,
            ComputePreview: self._background.preview,
            ReconstructRun: self._background.reconstruct,
            OpenRecord: self._background.open_record,
            RestoreCube: self._background.restore_cube,
            ShowCubeColours: self._background.show_cube_colours,
            ListBands: self._background.list_bands,
            SaveRestored: self._background.save_restored,
            SetTolerance: self._set_tolerance,
            ForecastAccuracy: self._background.forecast_accuracy,
            MeasureAccuracy: self._background.measure_accuracy,
            CancelJob: lambda command: self._jobs.cancel(command.job),
            AcquireBracket: self._planner.enqueue,
            RunPlan: self._planner.enqueue,
            ResumeRun: self._planner.enqueue,
            RestoreQueue: self._planner.restore,
            RemoveRuns: lambda command: self._queue.remove(command.numbers),
            ClearEndedRuns: lambda _: self._queue.clear(),
            ReleaseQueue: self._go_on,
            PauseRun: lambda command: self._queue.pause(command.on),
            AnswerPrompt: self._answer,
            Cancel: self._cancel,
            **self._alignment.at_once,
        }
        channel.immediate_handlers = {
            kind: self._reporting_errors(obey) for kind, obey in at_once.items()
        }
        channel.on_received = self._count_request
        channel.end_handlers += [self._stop, self._sender.close, self._awaited.close]

    def run(self) -> None:
        """Handle commands and take live frames until the window is gone.

        The caller, which opened the bench, leaves it safe.
        """
        self._channel.send(self._controller.describe_bench())
        while not self._channel.closed:
            looking = self._live and self._sender.has_room
            command = self._channel.take_command(self._pace.seconds_left if looking else 0.1)
            if command is not None:
                self._do(command)
            elif self._live and self._pace.is_due:
                self._take_frame()
        self._stop()
        self._planner.close()
        self._background.close()
        self._alignment.close()
        if self._prediction is not None:
            self._prediction.close()

    def _do(self, command: object) -> None:
        """Carry out a command, report errors, and report the bench's state."""
        try:
            self._obey[type(command)](command)
        except Exception as error:
            self._complain(error)
        self._tell()

    def _reporting_errors(self, obey: Callable[[Any], None]) -> Callable[[Any], None]:
        """Wrap a handler to report errors, which must not end the thread that receives Cancel."""

        def handle(command: object) -> None:
            try:
                obey(command)
            except Exception as error:
                self._complain(error)

        return handle

    def _complain(self, error: Exception) -> None:
        self._channel.send(describe_failure(error, self._controller))

    def _refuse(self, request: RunRequest, error: Exception) -> None:
        self._channel.send(RequestRefused(request.ticket))
        self._complain(error)

    def _tell(self, *, running: bool = False) -> None:
        self._channel.send(self._controller.read_state(self._live, running))

    def _tell_queue(self) -> None:
        queue = self._queue
        self._channel.send(QueueState(queue.run_infos(), queue.hold_reason, self._person.prompt))

    def _count_request(self, command: object) -> None:
        """Count a change of what pictures depend on, once it waits or is obeyed."""
        is_simulated = self._controller.live_tolerance.is_simulated
        if isinstance(command, _SETTINGS) or (isinstance(command, SetTolerance) and is_simulated):
            self._awaited.count_request(is_pattern=isinstance(command, ShowPattern))

    def _set_view(self, command: SetView) -> None:
        self._sender.set_view(command.view)
        self._pace.interval = command.refresh_interval

    def _set_live(self, command: SetLive) -> None:
        if command.on and not self._live:
            self._controller.restore_settings()
        self._change_live(command.on)

    def _change_live(self, on: bool) -> None:
        """Start or stop live view; no frame of before comes to the window after this."""
        if on != self._live:
            self._sender.discard()
        self._live = on
        self._awaited.set_live(on)

    def _take_frame(self) -> None:
        request = self._settled_request()
        self._pace.begin()
        doubt = self._controller.target_doubt
        try:
            with self._outdated.watch(), self._controller.live_tolerance.during_frame():
                frame = self._take_awaited_frame(request)
                self._effects.report_if_changed(frame)
            # In this order, no prediction follows the picture.
            self._awaited.note_picture(request)
            self._sender.offer(frame, request, self._alignment.offer)
            if self._controller.target_doubt != doubt:
                self._tell()
        except Exception as error:
            if self._outdated.is_given_up and isinstance(error, DeviceError):
                return
            self._change_live(False)
            self._complain(error)
            self._tell()

    def _take_awaited_frame(self, request: int) -> LiveFrame:
        """Take a frame, and say meanwhile what is awaited if its settings are new."""
        controller, cancelled = self._controller, self._outdated.is_cancelled
        if request <= self._awaited.reached:
            return controller.take_frame(cancelled)
        if self._forecast is None:
            self._awaited.note_activity(request, "exposing", controller.frame_seconds)
            return controller.take_frame(cancelled)
        self._awaited.note_activity(request, _COMPUTING, self._forecast.last_seconds)
        self._predict(request)
        with self._forecast.learn():
            expected = self._forecast.expected_seconds(controller.exposure)
            self._awaited.note_activity(request, _COMPUTING, expected)
            return controller.take_frame(cancelled)

    def _predict(self, request: int) -> None:
        """Show a coarse prediction of the next picture, unless the picture is earlier."""
        if self._prediction is None or request == 0:
            return

        def is_wanted() -> bool:
            awaited = self._awaited
            return self._live and awaited.reached < request == awaited.newest

        exposure, nothing = self._controller.exposure, np.empty((0, 0), np.uint16)
        self._prediction.begin(self._controller.label_frame(nothing, exposure, 0), is_wanted)

    def _settled_request(self) -> int:
        """Return which change a frame taken now belongs to; 0 while settings are on their way."""
        request = self._awaited.newest
        # In this order: a job posts its pattern before it ends.
        on_their_way = self._jobs.is_running("pattern") or self._channel.has_commands
        return 0 if on_their_way else request

    def _set_tolerance(self, command: SetTolerance) -> None:
        self._controller.live_tolerance.set(command.tol)
        self._background.set_tolerance(command.tol)

    def _reconnect(self, command: ReconnectDevice) -> None:
        self._controller.reconnect(command.device)
        if self._live:
            self._controller.restore_settings()
        self._channel.send(DeviceReconnected(command.device))

    def _answer(self, command: AnswerPrompt) -> None:
        self._person.answer(command.number, alternative=command.alternative)

    def _cancel(self, command: Cancel) -> None:
        self._stop()
        self._channel.send(CancelAcknowledged())

    def _stop(self) -> None:
        """Cancel the background jobs and the run under way."""
        self._jobs.cancel()
        self._queue.cancel()

    def _go_on(self, command: ReleaseQueue) -> None:
        self._queue.release()
        self._channel.post(StartQueuedRuns())

    def _run_all(self, command: StartQueuedRuns) -> None:
        """Take the queued runs in turn, with live view stopped.

        Live view is restored after the last run, if that run allows it.
        """
        while not self._channel.closed and (run := self._queue.begin()) is not None:
            self._live_again = self._live_again or self._live
            self._change_live(False)
            self._tell(running=True)
            may_move = self._take(run)
            if may_move and self._live_again and not self._queue.can_begin:
                self._live_again = False
                self._controller.restore_settings()
                self._change_live(True)

    def _take(self, run: QueuedRun) -> bool:
        """Take a queued run; return whether devices may be set after it."""
        try:
            ended = self._acquisition.take_run(run)
        except Exception as error:
            said = describe_failure(error, self._controller)
            self._queue.end(run, State.FAILED, said.message)
            self._channel.send(said)
            # These errors mean that the run couldn't begin, so no device was set.
            return isinstance(error, UserError | OSError)
        self._queue.end(run, ended.state, ended.message, ended.bench_seconds)
        self._channel.send(ended)
        # If frames are missing, the bench stays safe until a person uses it again.
        return ended.path is None or ended.state is State.COMPLETE
