"""A run in progress: it takes frame after frame, pauses, and recovers from failures."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame
from labapp.common.errors import UserError, WaitedTooLong
from labapp.files.plan_file import PlanFile
from labapp.files.write_locks import has_path, is_deleted
from labapp.runs.acquisition.attendance import Attendance, Idle, Meanwhile, wait_until
from labapp.runs.acquisition.frame_storage import FrameStore, require_full
from labapp.runs.acquisition.frame_taker import FrameTaker
from labapp.runs.acquisition.hooks import HookError, Hooks
from labapp.runs.acquisition.unplug_monitor import UnplugMonitor
from labapp.runs.bench_interface import Bench
from labapp.runs.record.logbook import logbook
from labapp.runs.record.reader import Record
from labapp.runs.record.writer import RecordWriter
from labapp.runs.shots import Shot, ShotList
from labapp.runs.state import State
from optics.progress import Cancelled, Progress

if TYPE_CHECKING:
    from labapp.runs.acquisition.scene_watch import SceneWatch
    from optics.camera import Camera as CameraDescription

log = logging.getLogger(__name__)


_FILE_LOST = "the file of the record was moved, deleted or replaced while the run wrote it"


class _TakeAgain(Exception):
    """A person wants a frame to be taken again."""


@dataclass(frozen=True)
class RunOutcome:
    """How a run ended.

    Parameters
    ----------
    path : Path
        File of the record.
    state : State
        COMPLETE, CANCELLED or FAILED.
    missing : list of int
        Indices of planned frames that aren't in the record.
    message : str
        Reason for the state; may be empty.
    expected_seconds, elapsed_seconds : float
        Expected and elapsed seconds of the bench's time, without pauses and prompts.
    device_error : DeviceError, optional
        Error of the device that ended the run, if one did.
    digest : str
        Digest over the whole record in hexadecimal; empty if it couldn't be written.
    waited_too_long : bool
        Whether the run ended because nobody mended in time what it waited for.
    """

    path: Path
    state: State
    missing: list[int]
    message: str
    expected_seconds: float = 0.0
    elapsed_seconds: float = 0.0
    device_error: DeviceError | None = None
    digest: str = ""
    waited_too_long: bool = False


class ActiveRun:
    """One run on a bench, which takes frames, writes its record and keeps its state."""

    def __init__(
        self,
        bench: Bench,
        plan: PlanFile,
        path: Path,
        patterns: Mapping[str, NDArray[np.uint8]],
        hooks: Hooks,
        attendance: Attendance,
        lock: int,
    ) -> None:
        self._bench, self._plan, self._path, self._lock = bench, plan, path, lock
        self._hooks, self._attendance, self._progress = hooks, attendance, attendance.progress
        ask = self._ask if attendance.ask else None
        self._taker = FrameTaker(
            bench, patterns, plan.seed, plan.retry, ask, self._progress, self._is_cancelled
        )
        self._done = self._expected = self._took = self._rested = 0.0
        self._trouble: DeviceError | None = None
        self._unplug_monitor = UnplugMonitor(bench.supervised_devices)
        self._doing = self._unplugged = self._unwritten = ""
        self._waited_too_long = False
        self._watch, self._changes = _watch_scene(plan, bench), list[str]()

    def take(self, shots: Sequence[Shot], *, is_resumed: bool = False) -> RunOutcome:
        """Take all frames into the record, release its lock, and return how the run ended."""
        with (
            RecordWriter(self._path, self._lock) as self._writer,
            logbook(self._writer, self._bench.clock) as self._logbook,
        ):
            as_planned = not self._bench.file.is_real
            self._store = FrameStore(self._writer, as_planned, self._pause)
            # What judges frames is loaded only once frames are taken.
            from labapp.runs.frame_doubts import FrameDoubts

            camera = _camera_as_metered(self._plan, self._bench)
            self._doubts = FrameDoubts(self._plan, camera, shots)
            self._expected = ShotList.of(shots).total_duration
            state, message = self._take_all(shots, is_resumed)
            if has_path(self._writer.handle, self._path):
                outcome = self._verify_outcome(state, message, is_resumed)
                if has_path(self._writer.handle, self._path):
                    return outcome
                message = outcome.message
            return self._outcome_elsewhere(message)

    def _take_all(self, listed: Sequence[Shot], again: bool) -> tuple[State, str]:
        """Take all frames, leave the bench safe whatever happens; return the state and reason."""
        state, message = State.FAILED, ""
        try:
            self._note_state(State.RUNNING)
            log.info("%s: %d frames to take", "resumed" if again else "started", len(listed))
            if again:
                # Without this line, what a power cut leaves couldn't be told from a damage.
                self._writer.flush()
            if limit := self._writer.lock_limit:
                log.warning("%s", limit)
            wavelengths = {shot.wavelength for shot in ShotList.of(listed).distinct("wavelength")}
            for doubt in self._bench.calibration_warnings_at(wavelengths):
                log.warning("%s", doubt)
            for role, device in self._bench.supervised_devices.items():
                for notice in device.notices:
                    log.warning("%s: %s", role, notice)
            for block in self._plan.acquire:
                if block.chosen is not None:
                    log.info("chosen: %s", block.chosen.describe())
            self._hooks.call("before_run", listed)
            with self._unplug_monitor, self._bench.cancellable_by(self._is_cancelled):
                for shot in listed:
                    self._take_one(shot)
            state, message = State.COMPLETE, "; ".join(self._changes)
        except (Cancelled, KeyboardInterrupt):
            state = State.CANCELLED
            message = "; ".join(["cancelled by the user", *self._bench.failed_devices()])
        except DeviceError as error:
            message, self._trouble = str(error), error
        except WaitedTooLong as error:
            what = self._doing.removeprefix("PAUSED: ")
            message, self._waited_too_long = f"{error}: {what}", True
        except (HookError, UserError) as error:
            message = str(error)
        except OSError as error:
            message = f"the record can't be written: {_in_words(error)}"
        except Exception as error:
            message = f"{type(error).__name__}: {error}"
            raise
        finally:
            for failure in self._bench.make_safe():
                message = f"{message}; not left safe: {failure}".removeprefix("; ")
            state, message = self._record_end(state, message)
        try:
            self._hooks.call("after_run", state.value)
        except HookError as error:
            return State.FAILED, str(error)
        return state, message

    def _take_one(self, shot: Shot) -> None:
        """Take one frame of the run, after waiting for pauses, disk space and hooks."""
        self._report(_describe(shot))
        if self._progress.is_paused:
            text, is_over = "paused by the user", lambda: not self._progress.is_paused
            self._pause(text, is_over, self._attendance.meanwhile or Idle(), math.inf)
        self._store.wait_for_space()
        if is_deleted(self._writer.handle):
            raise UserError(_FILE_LOST)
        self._hooks.call("before_frame", shot)
        began, rested = self._bench.clock.now(), self._rested
        frame = None
        while frame is None:
            try:
                frame = self._taker.take(shot, self._keep)
            except _TakeAgain:
                self._taker.invalidate_settings()
            except DeviceError as error:
                if self._plan.retry.then == "fail":
                    raise
                self._progress.pause()
                text = f"{error}. Mend it, then let the run go on"
                self._pause(text, lambda: not self._progress.is_paused)
        self._took += self._bench.clock.now() - began - (self._rested - rested)
        self._done += shot.duration
        if self._watch and (change := self._watch.compare(shot, frame)):
            self._changes.append(change)
            log.warning("%s", change)
        self._hooks.call("after_frame", shot, frame)
        if self._attendance.on_frame is not None:
            self._attendance.on_frame(shot, frame)

    def _keep(self, shot: Shot, frame: Frame, wavelength: float, attempt: int) -> None:
        """Store a frame of the run, unless a person doubts it and wants it to be taken again."""
        doubt = self._doubts.doubt(shot, shot.readout.whole_numbers(frame.image))
        if doubt:
            log.warning("frame %d is doubted: %s", shot.index, doubt)
            if (judge := self._attendance.judge) is not None:
                with self._paused_for_answer(doubt):
                    kept = judge(doubt, shot, frame, self._progress)
                log.info("kept by a person" if kept else "taken again")
                if not kept:
                    raise _TakeAgain
            self._doubts.settle(shot)
        self._store.store_frame(shot, frame, wavelength, attempt)

    def _is_cancelled(self) -> bool:
        """Return whether the run was cancelled, and report a device that was unplugged.

        This is called all the time while the run waits for devices.
        """
        unplugged = self._unplug_monitor.message
        if unplugged != self._unplugged:
            self._unplugged = unplugged
            if unplugged:
                self._progress.tell(f"UNPLUGGED: {unplugged}. Plug it in again, the run goes on")
            with suppress(Cancelled):
                self._report(self._doing)
        return self._progress.is_cancelled

    def _pause(
        self,
        message: str,
        is_over: Callable[[], bool],
        meanwhile: Meanwhile | None = None,
        limit: float | None = None,
    ) -> None:
        """Pause the run until `is_over()` returns true, with the reason in the record.

        Without `meanwhile`, nobody uses the bench. Raises Cancelled, or WaitedTooLong after `limit`
        seconds, which are those of the run's progress by default.
        """
        limit = self._progress.wait_limit if limit is None else limit
        log.warning("paused: %s", message)
        self._note_state(State.PAUSED, message)
        self._report(f"PAUSED: {message}")
        ends = "" if math.isinf(limit) else f". Else it ends in {limit:g} s (--wait-limit)"
        self._progress.tell(f"PAUSED: {message}{ends}")
        with self._excluding_time():
            if meanwhile is not None:
                self._taker.restore_camera()
            wait_until(is_over, self._progress, meanwhile or Idle(), limit)
        self._taker.invalidate_settings()
        log.info("goes on")
        self._progress.tell("the run goes on")
        self._note_state(State.RUNNING)

    def _note_state(self, state: State, message: str = "") -> None:
        """Write the state of a run that goes on; if the disk is full, the next frame tells."""
        try:
            self._writer.set_state(state, message)
        except OSError as error:
            require_full(error)

    @contextmanager
    def _excluding_time(self) -> Iterator[None]:
        """Exclude the time of the block from the time that the run takes."""
        began = self._bench.clock.now()
        try:
            yield
        finally:
            self._rested += self._bench.clock.now() - began

    @contextmanager
    def _paused_for_answer(self, question: str) -> Iterator[None]:
        """Set the run to PAUSED while a person is asked in the block."""
        self._note_state(State.PAUSED, question)
        self._report(question)
        with self._excluding_time():
            yield
        self._progress.raise_if_cancelled()
        self._note_state(State.RUNNING)

    def _ask(self, text: str, progress: Progress) -> None:
        assert self._attendance.ask is not None
        with self._paused_for_answer(text):
            self._attendance.ask(text, progress)

    def _report(self, message: str) -> None:
        """Report the run's progress, and any device that is unplugged."""
        self._doing = message
        share = self._done / self._expected if self._expected else 1.0
        told = f"UNPLUGGED: {self._unplugged} ({message})" if self._unplugged else message
        self._progress.report(share, told)

    def _record_end(self, state: State, message: str) -> tuple[State, str]:
        """Write the run's final state, and return it: FAILED if the disk doesn't keep the end."""
        # COMPLETE is written only when all frames have been read back, see _verify_outcome().
        written = State.RUNNING if state is State.COMPLETE else state
        log.log(logging.WARNING if message else logging.INFO, message or "all frames taken")
        log.info("expected %.3f s of bench time, took %.3f s", self._done, self._took)
        if not self._write_state(written, message) and written.has_ended:
            return State.FAILED, self._add_unwritten(message)
        return state, message

    def _add_unwritten(self, message: str) -> str:
        """Return the reason of the run's state, and what the disk refused of its record."""
        return f"{message}; its end isn't on the disk: {self._unwritten}".removeprefix("; ")

    def _write_state(self, state: State, message: str) -> str:
        """Write the run's state, and return the digest over its record if it has ended."""
        try:
            self._logbook.write_waiting()
            return self._writer.set_state(state, message)
        except OSError as error:
            self._unwritten = _in_words(error)
            log.error("the end of the run could not be written: %s", self._unwritten)
            return ""

    def _verify_outcome(self, state: State, message: str, is_resumed: bool) -> RunOutcome:
        """Return how the run ended: COMPLETE only if every frame reads back from the record.

        If it was begun earlier, it must pass all checks, too.
        """
        is_complete = state is State.COMPLETE
        with Record(self._path) as record:
            # Reading all frames back takes time, so a run that was cancelled or failed skips it.
            missing = record.missing_frames() if is_complete else record.frames_not_stored()
        if state is State.COMPLETE and missing:
            state, message = State.FAILED, f"{len(missing)} frames don't read back"
        digest = self._write_state(state, message)
        if not digest:
            state, message = State.FAILED, self._add_unwritten(message)
            digest = self._write_state(state, message)
            with Record(self._path) as record:
                missing = record.frames_not_stored()
        if state is State.COMPLETE and is_resumed:
            from labapp.runs.record.checks import check_record

            found = check_record(self._path)
            if not found.is_in_order:
                state, message = State.FAILED, f"not in order: {found.reason}"
                digest = self._write_state(state, message)
        return self._outcome(self._path, state, missing, message, digest)

    def _outcome(
        self, path: Path, state: State, missing: list[int], message: str, digest: str
    ) -> RunOutcome:
        """Return how the run ended, with what it has counted."""
        return RunOutcome(
            path, state, missing, message, self._done, self._took, self._trouble, digest,
            self._waited_too_long,
        )  # fmt: skip

    def _outcome_elsewhere(self, message: str) -> RunOutcome:
        """Return how a run ended whose record isn't the file on its path any more: FAILED."""
        from labapp.runs.record.lost_file import find_or_copy

        told = message if _FILE_LOST in message else f"{message}; {_FILE_LOST}".removeprefix("; ")
        digest = self._write_state(State.FAILED, told)
        try:
            path = find_or_copy(self._writer.handle, self._path)
            with Record(path) as record:
                missing = record.frames_not_stored()
            told = f"{told}. Its frames are in {path}"
        except (OSError, UserError) as error:
            path, missing = self._path, list(range(self._writer.frame_count))
            told = f"{told}, and its frames could not be kept: {error}"
        log.error("%s: %s", self._path, told)
        return self._outcome(path, State.FAILED, missing, told, digest)


def _in_words(error: OSError) -> str:
    """Return why the disk refused a part of a run's record."""
    return error.strerror or str(error)


def _watch_scene(plan: PlanFile, bench: Bench) -> SceneWatch | None:
    """Return what compares a run's frames with what was metered; None if nothing was."""
    if not any(block.chosen and block.chosen.metered for block in plan.acquire):
        return None
    from labapp.runs.acquisition.scene_watch import SceneWatch

    return SceneWatch(plan, _camera_as_metered(plan, bench).sensor)


def _camera_as_metered(plan: PlanFile, bench: Bench) -> CameraDescription:
    """Return the run's camera, with the clip level that metering has found."""
    from labapp.runs.brackets.clip_remarks import metered_clip_level

    camera, found = bench.description, metered_clip_level(plan)
    if found is None or bench.file.tells_clip_level:
        return camera
    return replace(camera, sensor=replace(camera.sensor, clip_level=found.clip_level_dn))


def _describe(shot: Shot) -> str:
    """Describe a run's shot by its role, target, pattern, wavelength and exposure."""
    nm, ms = shot.wavelength * 1e9, shot.exposure * 1e3
    role = "" if shot.role in ("light", shot.target) else f"{shot.role}, "
    read = shot.readout.describe()
    return f"{role}{shot.target}, {shot.pattern}, {nm:g} nm, {ms:g} ms{read and ', '}{read}"
