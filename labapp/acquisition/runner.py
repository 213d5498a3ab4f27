"""Running a plan: the one engine behind window, command line and Python."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame
from labapp.acquisition.state import State
from labapp.acquisition.steps import Shot, check, shots
from labapp.acquisition.taking import Taker
from labapp.bench import Bench
from labapp.files.plan_file import PlanFile
from labapp.files.writing import require_writable
from labapp.patterns import compute_patterns
from labapp.record.logbook import logbook
from labapp.record.reader import Record
from labapp.record.writer import Contents, RecordWriter, mark
from labapp.stopwatch import Stopwatch
from optics.progress import Cancelled, Progress
from simulator.world import World

log = logging.getLogger(__name__)

_PATTERNS_SHARE = 0.3
"""Of a run's progress; the frames have the rest."""

OnFrame = Callable[[Shot, Frame], None]


@dataclass(frozen=True)
class Outcome:
    """How a run ended. missing: indices of planned frames that aren't in the record."""

    path: Path
    state: State
    missing: list[int]
    message: str


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
    watch: Stopwatch | None = None,
) -> Outcome:
    """Take every frame of a plan into a record, and leave the bench safe.

    source: the plan's name in errors. folder: where its picture files are. on_frame: is
    called with each frame once it is on disk. watch: is told how long the stages took.
    Cancelling the progress ends the run with the state CANCELLED; a failing device or disk
    with FAILED. UserError if the plan can't be run at all; then nothing was moved or written.
    """
    progress, watch = progress or Progress(), watch or Stopwatch()
    check(plan, bench, source)
    require_writable(path, force=force)
    with watch.stage("compute patterns"):
        part = progress.part(0, _PATTERNS_SHARE)
        patterns = compute_patterns(plan.patterns, bench.description, plan.seed, part, folder)
    with watch.stage("acquire"):
        contents = _contents(bench, plan, patterns)
        with RecordWriter(path, contents, force=force) as writer, logbook(writer, bench.clock):
            part = progress.part(_PATTERNS_SHARE, 1)
            state, message = _take_all(bench, contents, writer, part, on_frame)
        return _conclude(path, state, message)


def _take_all(
    bench: Bench,
    contents: Contents,
    writer: RecordWriter,
    progress: Progress,
    on_frame: OnFrame | None,
) -> tuple[State, str]:
    """The frames one after the other; the state that the run deserves, and why."""
    state, message = State.FAILED, ""
    try:
        writer.set_state(State.RUNNING)
        log.info("started: %d frames planned", len(contents.shots))
        taker = Taker(bench, contents.patterns, contents.seed)
        for shot in contents.shots:
            progress.report(shot.index / len(contents.shots), _describe(shot))
            frame = taker.take(shot, progress)
            writer.store(shot, frame, bench.filter.wavelength)
            if on_frame is not None:
                on_frame(shot, frame)
        state = State.COMPLETE
    except (Cancelled, KeyboardInterrupt):
        state, message = State.CANCELLED, "cancelled by the user"
    except (DeviceError, OSError) as error:
        message = str(error)
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        raise
    finally:
        for failure in bench.make_safe():
            message = f"{message}; not left safe: {failure}" if message else str(failure)
        _say_last_words(writer, state, message)
    return state, message


def _say_last_words(writer: RecordWriter, state: State, message: str) -> None:
    """Write how the run ended; a full disk may not even take that, and the log says so."""
    # COMPLETE is not written here: it has to be earned by reading back.
    written = State.RUNNING if state is State.COMPLETE else state
    log.log(logging.WARNING if message else logging.INFO, message or "all frames taken")
    try:
        writer.set_state(written, message)
    except OSError as error:
        log.error("%s: the end of the run could not be written: %s", writer.path, error)


def _conclude(path: Path, state: State, message: str) -> Outcome:
    """COMPLETE if every frame reads back from a fresh handle, else what is missing."""
    with Record(path) as record:
        missing = record.missing()
    if state is State.COMPLETE and missing:
        state, message = State.FAILED, f"{len(missing)} frames don't read back"
    mark(path, state, message)
    return Outcome(path, state, missing, message)


def _describe(shot: Shot) -> str:
    nm, ms = shot.wavelength * 1e9, shot.exposure * 1e3
    return f"{shot.target}, {shot.pattern}, {nm:g} nm, {ms:g} ms"


def _contents(bench: Bench, plan: PlanFile, patterns: Mapping[str, NDArray[np.uint8]]) -> Contents:
    return Contents(
        title=plan.title,
        seed=plan.seed,
        plan=plan.model_dump(mode="json"),
        bench=bench.file.model_dump(mode="json"),
        scene=bench.scene_file.model_dump(mode="json") if bench.scene_file else None,
        effect_plan=_effect_plans(bench.world, plan, patterns) if bench.world else None,
        identities={name: device.identity for name, device in bench.devices.items()},
        targets=bench.targets.names,
        patterns=patterns,
        shots=shots(plan),
        frame_shape=bench.camera.shape,
        pixel_pitch=bench.description.sensor.pitch,
    )


def _effect_plans(
    world: World, plan: PlanFile, patterns: Mapping[str, NDArray[np.uint8]]
) -> dict[str, Any]:
    """What the simulator decides for each pattern and wavelength of a plan."""
    plans = {}
    for shot in shots(plan):
        key = f"{shot.pattern}, {shot.wavelength * 1e9:g} nm"
        if key not in plans:
            decided = world.effect_plan(patterns[shot.pattern], shot.wavelength)
            plans[key] = decided.as_data()
    return plans
