"""Finding and focusing: measure, try exposures, and keep pictures."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from numpy.typing import NDArray

from drivers.errors import DeviceError
from labapp.bench.opening import Bench
from labapp.common.errors import UserError
from labapp.files.bracket_table import BracketTable
from labapp.runs.brackets.choice import exposure_limits
from labapp.runs.brackets.clip_remarks import clip_remark
from labapp.runs.capabilities import BenchCapabilities
from labapp.window.engine.bench_controller import BenchController
from labapp.window.engine.channel import Channel
from labapp.window.engine.failures import describe_failure
from labapp.window.engine.frame_sender import FrameSender
from labapp.window.engine.jobs import Jobs
from labapp.window.engine.kept_pictures import KeptPictures
from labapp.window.engine.picture_measurer import PictureMeasurer
from labapp.window.measuring_messages import (
    BracketProposal,
    ExposureFound,
    FindExposure,
    FindStar,
    KeepPicture,
    MeasurePictures,
    PixelRegion,
    ProposeBracket,
)
from labapp.window.messages import LiveFrame, PictureSaved
from optics.progress import Cancelled, Progress

EXPOSURE_JOB, BRACKET_JOB = "exposure", "bracket proposal"
"""Names of the jobs that use the camera, by which the window cancels them."""


class Alignment:
    """Carry out the commands for finding, focusing, exposing and keeping.

    `by_bench` are to be called in the thread that owns the bench; `at_once` in any.
    """

    def __init__(
        self,
        bench: Bench,
        channel: Channel,
        sender: FrameSender,
        controller: BenchController,
        jobs: Jobs,
    ) -> None:
        self._bench, self._channel, self._sender = bench, channel, sender
        self._controller, self._jobs = controller, jobs
        self._sensor = bench.description.sensor
        self._abilities = BenchCapabilities.of(bench)
        self.is_given_up: Callable[[], bool] = lambda: False
        """Whether what tries exposures must end, as when a run goes on that has waited."""
        self._measurer = PictureMeasurer(channel, self._sensor, self._complain)
        self._kept = KeptPictures(bench)
        self._writing = ThreadPoolExecutor(1, "keeping")
        self.by_bench: dict[type, Callable[[Any], None]] = {
            FindExposure: self._find_exposure,
            ProposeBracket: self._propose_bracket,
        }
        self.at_once: dict[type, Callable[[Any], None]] = {
            MeasurePictures: self._measurer.ask,
            FindStar: lambda _: self._measurer.find_star(),
            KeepPicture: self._keep,
        }

    def close(self) -> None:
        """Finish writing the pictures that are kept; the window is gone."""
        self._writing.shutdown()

    def offer(self, frame: LiveFrame) -> None:
        """Offer a live picture for measurements, and to be kept."""
        self._measurer.offer(frame)
        self._kept.offer(frame)

    def _complain(self, error: Exception) -> None:
        self._channel.send(describe_failure(error, self._controller))

    def keep_shown(self, frame: LiveFrame) -> None:
        """Hold a run's picture that is shown, so that it can be kept.

        It isn't measured: from frame to frame, a run changes what is seen.
        """
        self._kept.offer(frame)

    def _keep(self, command: KeepPicture) -> None:
        """Write a picture in a thread of its own, since a disk takes its time."""

        def work() -> None:
            try:
                path = self._kept.keep(command.number, command.folder)
                self._channel.send(PictureSaved(path))
            except Exception as error:
                self._complain(error)

        self._writing.submit(work)

    def _find_exposure(self, command: FindExposure) -> None:
        """Set the exposure that brings the brightest pixel to a level."""
        from labapp.window.engine.light_metering import SETTINGS, find_exposure

        wanted = BracketTable(snr_db=SETTINGS.snr_db, longest_ms=SETTINGS.longest * 1e3)
        limits = exposure_limits(wanted, self._abilities, None)

        def work(progress: Progress) -> None:
            take = self._trial_frames(command.region, progress)
            first = self._controller.exposure
            told = self._bench.file.tells_clip_level
            found = find_exposure(take, self._sensor, limits, command.level, first, told)
            self._controller.set_exposure(found.exposure)
            self._channel.send(
                ExposureFound(found.exposure, found.level, command.level, found.frames, found.limit)
            )

        self._try_exposures(EXPOSURE_JOB, work)

    def _propose_bracket(self, command: ProposeBracket) -> None:
        """Propose a bracket for the light that the camera sees now."""
        from labapp.window.engine.light_metering import propose_exposures

        wanted = BracketTable(snr_db=command.snr_db, decades=command.decades)
        limits = exposure_limits(wanted, self._abilities, self._abilities.flicker_period)

        def work(progress: Progress) -> None:
            before = self._controller.exposure
            take = self._trial_frames(None, progress)
            found = propose_exposures(
                take,
                self._sensor,
                limits,
                command.snr_db,
                command.decades,
                before,
                self._bench.file.tells_clip_level,
            )
            self._controller.try_exposure(before)
            if remark := clip_remark(found.metered, self._sensor):
                self._complain(UserError(f"{remark}."))
            bench = self._bench
            self._channel.send(
                BracketProposal(
                    row=command.row,
                    target=bench.targets.current_target,
                    pattern=bench.slm.displayed_pattern,
                    wavelength=bench.filter.wavelength,
                    snr_db=command.snr_db,
                    least_snr_db=found.least_snr_db,
                    electrons_per_s=(found.metered.low, found.metered.high),
                    exposures_ms=tuple(round(time * 1e3, 6) for time in found.bracket.times),
                    seconds=found.seconds,
                    ladders=tuple(found.ladders.items()),
                    metering_frames=len(found.metered.times),
                )
            )

        self._try_exposures(BRACKET_JOB, work)

    def _try_exposures(self, job: str, work: Callable[[Progress], None]) -> None:
        """Do something by trial frames; if it fails, set the exposure of before."""
        progress, before = self._jobs.begin(job), self._controller.exposure
        try:
            work(progress)
        except Exception as error:
            with suppress(DeviceError):
                self._controller.try_exposure(before)
            if isinstance(error, ValueError):
                raise UserError(f"The exposure stays as it was: {error}.") from error
            if not isinstance(error, Cancelled):
                raise
        finally:
            self._jobs.end(job, progress)

    def _trial_frames(
        self, region: PixelRegion | None, progress: Progress
    ) -> Callable[[float], tuple[float, NDArray[Any]]]:
        """Return what takes trial frames of a region, until it is cancelled."""

        def take(exposure: float) -> tuple[float, NDArray[Any]]:
            self._raise_if_given_up(progress)
            progress.report(0.0, f"trial frame of {exposure * 1e3:g} ms")
            self._controller.try_exposure(exposure)
            try:
                with self._controller.live_tolerance.during_frame():
                    frame = self._controller.take_frame(lambda: self._must_end(progress))
            except DeviceError:
                # A camera that was cancelled says so by an error.
                self._raise_if_given_up(progress)
                raise
            self._raise_if_given_up(progress)
            self._show(frame)
            return frame.exposure, _part(frame, region)

        return take

    def _must_end(self, progress: Progress) -> bool:
        """Return whether a trial frame must end before it is complete."""
        # A simulated exposure takes no time, and a computation that is cancelled may seem to hang.
        unwanted = self._bench.file.is_real and self.is_given_up()
        return self._channel.closed or progress.is_cancelled or unwanted

    def _raise_if_given_up(self, progress: Progress) -> None:
        progress.raise_if_cancelled()
        if self.is_given_up():
            raise Cancelled("the run goes on")

    def _show(self, frame: LiveFrame) -> None:
        """Send a trial frame, if there is room, so that a person sees what goes on."""
        if self._sender.has_room:
            self._sender.offer(frame, on_sent=self._kept.offer)


def _part(frame: LiveFrame, region: PixelRegion | None) -> NDArray[Any]:
    """Return a region of a live picture; ValueError if it lies outside."""
    if region is None:
        return frame.image
    from optics.measuring import Region

    rows, columns = frame.image.shape
    return Region(*region).within((rows, columns)).of(frame.image)
