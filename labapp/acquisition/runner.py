"""Running a plan: the one engine behind window, command line and Python."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame
from labapp.acquisition.abilities import Abilities
from labapp.acquisition.checking import check, expect
from labapp.acquisition.hooks import HookError, Hooks
from labapp.acquisition.keeping import Keeper, require_space
from labapp.acquisition.state import State
from labapp.acquisition.steps import Shot, shots
from labapp.acquisition.taking import Ask, Taker
from labapp.bench import Bench
from labapp.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.writing import require_writable
from labapp.patterns import compute_patterns
from labapp.record.logbook import logbook
from labapp.record.making import Contents, make
from labapp.record.reader import Record, digest
from labapp.record.writer import RecordWriter
from labapp.stopwatch import Stopwatch
from optics.progress import Cancelled, Progress
from simulator.world import World

log = logging.getLogger(__name__)

_PATTERNS_SHARE = 0.3
"""Of a run's progress; the frames have the rest."""

_LOOK = 0.05
"""Seconds between looks at whether a pause is over."""

OnFrame = Callable[[Shot, Frame], None]


@dataclass(frozen=True)
class Outcome:
    """How a run ended. missing: indices of planned frames that aren't in the record.

    expected, took: seconds of the bench's time, without what persons and pauses took.
    trouble: with the device that ended it, if one did.
    """

    path: Path
    state: State
    missing: list[int]
    message: str
    expected: float = 0.0
    took: float = 0.0
    trouble: DeviceError | None = None


def run_plan(
    bench: Bench,
    plan: PlanFile,
    path: Path,
    *,
    source: str = "plan",
    folder: Path = Path(),
    force: bool = False,
    progress: Progress | None = None,
    on_frame: OnFrame | None = None,
    ask: Ask | None = None,
    watch: Stopwatch | None = None,
) -> Outcome:
    """Take every frame of a plan into a record, and leave the bench safe.

    source: the plan's name in errors. folder: where its picture files are. on_frame: is
    called with each frame once it is on disk. ask: a person, where the plan has prompts.
    watch: is told how long the stages took. Pausing the progress rests the run after a
    frame; cancelling it ends the run with the state CANCELLED; a device that fails as often
    as the plan allows, or a failing disk, with FAILED. A full disk pauses it. UserError if
    the plan can't be run at all; then nothing was moved or written.
    """
    progress, watch = progress or Progress(), watch or Stopwatch()
    abilities = Abilities.of(bench)
    check(plan, abilities, source)
    listed = shots(plan, abilities)
    expected = expect(listed, plan, abilities)
    require_writable(path, force=force)
    require_space(path, expected.disk_bytes)
    _require_person(ask, expected.prompts)
    hooks = Hooks.of(plan, bench)
    with watch.stage("compute patterns"):
        part = progress.part(0, _PATTERNS_SHARE)
        patterns = compute_patterns(plan.patterns, bench.description, plan.seed, part, folder)
    with watch.stage("acquire"):
        make(path, _contents(bench, plan, patterns, listed, abilities), force=force)
        run = _Run(bench, plan, path, patterns, hooks, ask, progress.part(_PATTERNS_SHARE, 1))
        return run.take(listed, on_frame)


def resume_run(
    bench: Bench,
    path: Path,
    *,
    progress: Progress | None = None,
    on_frame: OnFrame | None = None,
    ask: Ask | None = None,
) -> Outcome:
    """Take the frames that a record lacks, with its own plan, patterns and seed.

    A frame that doesn't read back as it was stored is taken again. Nothing happens to a
    record that is whole. UserError if the bench isn't the one that the run began on, or
    the record is still being written.
    """
    progress = progress or Progress()
    abilities = Abilities.of(bench)
    with Record(path) as record:
        plan, missing = record.plan, record.missing()
        patterns = {name: record.pattern(name) for name in record.pattern_names}
        check(plan, abilities, str(path))
        listed = shots(plan, abilities)
        _require_same(record, bench, listed)
    left = [listed[index] for index in missing]
    require_space(path, 2 * len(left) * abilities.frame_shape[0] * abilities.frame_shape[1])
    _require_person(ask, expect(left, plan, abilities).prompts)
    hooks = Hooks.of(plan, bench)
    return _Run(bench, plan, path, patterns, hooks, ask, progress).take(left, on_frame, again=True)


class _Run:
    """One run under way: what it shares, and its state."""

    def __init__(
        self,
        bench: Bench,
        plan: PlanFile,
        path: Path,
        patterns: Mapping[str, NDArray[np.uint8]],
        hooks: Hooks,
        ask: Ask | None,
        progress: Progress,
    ) -> None:
        self._bench, self._plan, self._path = bench, plan, path
        self._hooks, self._progress = hooks, progress
        self._ask = self._waiting_for(ask) if ask else None
        self._taker = Taker(bench, patterns, plan.seed, plan.retry, self._ask, progress)
        self._done = self._expected = self._took = 0.0
        self._trouble: DeviceError | None = None

    def take(
        self, listed: Sequence[Shot], on_frame: OnFrame | None, *, again: bool = False
    ) -> Outcome:
        """The frames one after the other; how the run ended."""
        with RecordWriter(self._path) as self._writer, logbook(self._writer, self._bench.clock):
            rows, columns = self._bench.camera.shape
            as_planned = not self._bench.file.is_real
            keeper = Keeper(self._writer, 2 * rows * columns, as_planned, self._pause)
            self._expected = sum(shot.lasts for shot in listed)
            state, message = self._take_all(listed, keeper, on_frame, again)
            return self._conclude(state, message)

    def _take_all(
        self, listed: Sequence[Shot], keeper: Keeper, on_frame: OnFrame | None, again: bool
    ) -> tuple[State, str]:
        """Leaves the bench safe however it ends; the state that the run deserves, and why."""
        state, message = State.FAILED, ""
        try:
            self._writer.set_state(State.RUNNING)
            log.info("%s: %d frames to take", "resumed" if again else "started", len(listed))
            self._hooks.before_run(listed)
            with self._bench.heeding(lambda: self._progress.cancelled):
                for shot in listed:
                    self._take_one(shot, keeper, on_frame)
            state = State.COMPLETE
        except (Cancelled, KeyboardInterrupt):
            state = State.CANCELLED
            message = "; ".join(["cancelled by the user", *self._bench.deaths()])
        except DeviceError as error:
            message, self._trouble = str(error), error
        except (HookError, UserError, OSError) as error:
            message = str(error)
        except Exception as error:
            message = f"{type(error).__name__}: {error}"
            raise
        finally:
            for failure in self._bench.make_safe():
                message = f"{message}; not left safe: {failure}".removeprefix("; ")
            self._say_last_words(state, message)
        try:
            self._hooks.after_run(state.value)
        except HookError as error:
            return State.FAILED, str(error)
        return state, message

    def _take_one(self, shot: Shot, keeper: Keeper, on_frame: OnFrame | None) -> None:
        """One frame, when nothing speaks against it; a failing device may pause the run."""
        self._report(_describe(shot))
        if self._progress.paused:
            self._pause("paused by the user", lambda: not self._progress.paused)
        keeper.wait_for_space()
        self._hooks.before_frame(shot)
        began = self._bench.clock.now()
        frame = self._persist(shot, keeper)
        self._took += self._bench.clock.now() - began
        self._done += shot.lasts
        self._hooks.after_frame(shot, frame)
        if on_frame is not None:
            on_frame(shot, frame)

    def _persist(self, shot: Shot, keeper: Keeper) -> Frame:
        while True:
            try:
                return self._taker.take(shot, keeper.keep)
            except DeviceError as error:
                if self._plan.retry.then == "fail":
                    raise
                self._progress.pause()
                text = f"{error}. Mend it, then let the run go on"
                self._pause(text, lambda: not self._progress.paused)

    def _pause(self, message: str, over: Callable[[], bool]) -> None:
        """Rest until `over()`, with the reason in the record; Cancelled ends it, too."""
        log.warning("paused: %s", message)
        self._writer.set_state(State.PAUSED, message)
        self._report(f"PAUSED: {message}")
        while not over():
            self._progress.check()
            time.sleep(_LOOK)
        self._taker.forget()
        log.info("goes on")
        self._writer.set_state(State.RUNNING)

    def _waiting_for(self, ask: Ask) -> Ask:
        """Ask a person, with the state PAUSED while nobody has answered."""

        def asking(text: str, progress: Progress) -> None:
            self._writer.set_state(State.PAUSED, text)
            self._report(text)
            ask(text, progress)
            progress.check()
            self._writer.set_state(State.RUNNING)

        return asking

    def _report(self, message: str) -> None:
        share = self._done / self._expected if self._expected else 1.0
        self._progress.report(share, message)

    def _say_last_words(self, state: State, message: str) -> None:
        """Write how the run ended; a full disk may not even take that, and the log says so."""
        # COMPLETE is not written here: it has to be earned by reading back.
        written = State.RUNNING if state is State.COMPLETE else state
        log.log(logging.WARNING if message else logging.INFO, message or "all frames taken")
        log.info("expected %.3f s of bench time, took %.3f s", self._done, self._took)
        try:
            self._writer.set_state(written, message)
        except OSError as error:
            log.error("%s: the end of the run could not be written: %s", self._path, error)

    def _conclude(self, state: State, message: str) -> Outcome:
        """COMPLETE if every frame reads back from a fresh handle, else what is missing."""
        with Record(self._path) as record:
            # Who cancels wants to go; who gets COMPLETE wants to be sure.
            missing = record.missing() if state is State.COMPLETE else record.not_stored()
        if state is State.COMPLETE:
            if missing:
                state, message = State.FAILED, f"{len(missing)} frames don't read back"
            self._writer.set_state(state, message)
        return Outcome(self._path, state, missing, message, self._done, self._took, self._trouble)


def _require_person(ask: Ask | None, prompts: Sequence[str]) -> None:
    if prompts and ask is None:
        raise UserError(
            f"the plan asks a person {len(prompts)} times, first: {prompts[0]!r}. "
            "Run it where somebody answers, or say that all is in place (--yes)."
        )


def _require_same(record: Record, bench: Bench, listed: Sequence[Shot]) -> None:
    """UserError unless the bench takes the frames that the record was begun with."""
    for name, device in record.devices.items():
        identity = asdict(bench.devices[name].identity)
        if identity != device:
            raise UserError(
                f"{record.path}: was begun with the {name} {device['model']} "
                f"{device['serial']}, and this bench has {identity['model']} "
                f"{identity['serial']}. Resume it on the bench that it was begun on."
            )
    exposures = record.column("exposure_asked").tolist()
    same = (
        [shot.exposure for shot in listed] == exposures
        and [shot.step for shot in listed] == record.column("step").tolist()
        and bench.camera.shape == record.image(0).shape
        and bench.file == record.bench
    )
    if not same:
        raise UserError(
            f"{record.path}: this bench differs from the one that the run was begun on. "
            "Leave --bench out to resume it on its own."
        )


def _describe(shot: Shot) -> str:
    nm, ms = shot.wavelength * 1e9, shot.exposure * 1e3
    role = "" if shot.role in ("light", shot.target) else f"{shot.role}, "
    return f"{role}{shot.target}, {shot.pattern}, {nm:g} nm, {ms:g} ms"


def _contents(
    bench: Bench,
    plan: PlanFile,
    patterns: Mapping[str, NDArray[np.uint8]],
    listed: Sequence[Shot],
    abilities: Abilities,
) -> Contents:
    scene = bench.scene_file
    return Contents(
        title=plan.title,
        seed=plan.seed,
        plan=plan.model_dump(mode="json"),
        bench=bench.file.model_dump(mode="json"),
        scene=scene.model_dump(mode="json") if scene else None,
        effect_plan=_effect_plans(bench.world, listed, patterns) if bench.world else None,
        identities={name: device.identity for name, device in bench.devices.items()},
        targets=list(dict.fromkeys(shot.target for shot in listed)),
        patterns=patterns,
        shots=listed,
        frame_shape=abilities.frame_shape,
        pixel_pitch=bench.description.sensor.pitch,
        video_frame=abilities.video_frame,
        pictures={str(path): digest(path) for path in scene.pictures} if scene else {},
        faults=[asdict(fault) for fault in bench.world.faults.script] if bench.world else (),
    )


def _effect_plans(
    world: World, listed: Sequence[Shot], patterns: Mapping[str, NDArray[np.uint8]]
) -> dict[str, Any]:
    """What the simulator decides for each pattern and wavelength of a plan."""
    plans = {}
    for shot in listed:
        key = f"{shot.pattern}, {shot.wavelength * 1e9:g} nm"
        if key not in plans:
            decided = world.effect_plan(patterns[shot.pattern], shot.wavelength)
            plans[key] = decided.as_data()
    return plans
