"""What the window and its engine say to each other. SI units; nothing heavy is imported."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.runs.state import State
from labapp.window.exposure_bracket import ExposureBracket

PatternTable = dict[str, Any]
"""A pattern as a plan file writes it: its kind, and the keys of that kind."""


class Command:
    """What the window asks of the engine."""


@dataclass(frozen=True)
class SetLive(Command):
    """Take one picture after the other, or stop."""

    on: bool


@dataclass(frozen=True)
class PlaceTarget(Command):
    target: str


@dataclass(frozen=True)
class SetWavelength(Command):
    """wavelength: metres."""

    wavelength: float


@dataclass(frozen=True)
class SetExposure(Command):
    """exposure: seconds."""

    exposure: float


@dataclass(frozen=True)
class ComputePreview(Command):
    """Compute a pattern and the PSF that it gives at a wavelength in metres."""

    pattern: PatternTable
    wavelength: float


@dataclass(frozen=True)
class ShowPattern(Command):
    """Compute a pattern and put it on the SLM."""

    pattern: PatternTable


@dataclass(frozen=True)
class AcquireBracket(Command):
    """Put a bracket of the star and of the photograph in line; its record goes to `folder`."""

    pattern: PatternTable
    wavelength: float
    star: ExposureBracket
    photograph: ExposureBracket
    folder: Path


@dataclass(frozen=True)
class RunPlan(Command):
    """Put the run of a plan file in line; its record goes to `folder`."""

    plan: Path
    folder: Path


@dataclass(frozen=True)
class ResumeRun(Command):
    """Put the frames that a record lacks in line."""

    path: Path


@dataclass(frozen=True)
class RemoveRuns(Command):
    """Take runs that still wait out of the line."""

    numbers: tuple[int, ...]


@dataclass(frozen=True)
class ClearEndedRuns(Command):
    """Forget the runs that have ended; their files stay."""


@dataclass(frozen=True)
class ReleaseQueue(Command):
    """Begin the next run, though the last one didn't end well."""


@dataclass(frozen=True)
class PauseRun(Command):
    """Let the run under way rest after its frame, or go on."""

    on: bool


@dataclass(frozen=True)
class AnswerPrompt(Command):
    """What a run asked for is done. number: of the prompt."""

    number: int


@dataclass(frozen=True)
class ReconnectDevice(Command):
    """Open a device that has failed again. device: the bench's name of it."""

    device: str


@dataclass(frozen=True)
class ReconstructRun(Command):
    """Undo the blur of a record's photograph. budget: processor seconds; None: the usual."""

    path: Path
    method: str
    budget: float | None


@dataclass(frozen=True)
class SaveRestored(Command):
    """Write what was restored last to a file."""

    path: Path


@dataclass(frozen=True)
class Cancel(Command):
    """Stop the work that is under way; runs that wait go on waiting."""


@dataclass(frozen=True)
class AcknowledgeFrame(Command):
    """The window has taken a frame in and has room for the next."""


# From the engine to the window.


@dataclass(frozen=True)
class DeviceInfo:
    """A device of the bench: what it is, how it is, and the last value read from it.

    error: what is wrong with it, if its state is "failed" or "unplugged".
    """

    name: str
    model: str
    simulated: bool
    state: str = "ready"
    value: str = ""
    error: str = ""


@dataclass(frozen=True)
class BenchOpened:
    """What the bench can do. Ranges in metres and seconds; shapes are (rows, columns).

    virtual: whether its clock takes no real time.
    """

    name: str
    devices: tuple[DeviceInfo, ...]
    targets: tuple[str, ...]
    wavelength_range: tuple[float, float]
    exposure_range: tuple[float, float]
    camera_shape: tuple[int, int]
    full_scale: int
    virtual: bool


@dataclass(frozen=True)
class BenchState:
    """What the devices are really set to, read back from them; of a dead one, the last."""

    devices: tuple[DeviceInfo, ...]
    target: str
    pattern: str
    wavelength: float
    exposure: float
    live: bool

    @property
    def failed_devices(self) -> set[str]:
        """The bench's names of the devices that don't do as they are told."""
        return {device.name for device in self.devices if device.error}


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A raw picture, and everything that it was really taken with."""

    image: NDArray[np.uint16]
    target: str
    pattern: str
    wavelength: float
    exposure: float
    number: int


@dataclass(frozen=True)
class EffectInfo:
    """An effect that the simulated bench could have, and how far the simulator goes with it.

    level: in words. on: whether it takes part. forced: whether the scene says so. error_bound: the
    most that the level changes against the finest, relative; None: no limit is known.
    error_estimate: what it is likely to be. why: what there is of it in this picture.
    bound_source: where the limit comes from.
    """

    name: str
    level: str
    on: bool
    forced: bool
    error_bound: float | None
    error_estimate: float
    why: str
    physics: str
    source: str
    bound_source: str


@dataclass(frozen=True)
class EffectsReport:
    """What the simulator does for pictures of a setting: its effects, in the order of the light.

    error: the most by which the picture differs from that with everything on, relative; None:
    no limit is known. tol: what was allowed. work: its share of the work of everything on.
    """

    target: str
    pattern: str
    wavelength: float
    exposure: float
    effects: tuple[EffectInfo, ...]
    tol: float
    error: float | None
    work: float


@dataclass(frozen=True, eq=False)
class PatternPreview:
    """A pattern's grey levels, made smaller, and its PSF on sensor pixels (peak 1)."""

    pattern: PatternTable
    name: str
    grey: NDArray[np.uint8]
    psf: NDArray[np.float32]
    peak: float


@dataclass(frozen=True)
class JobProgress:
    """How far a job is. fraction: 0 to 1. seconds_left: None while nobody can tell."""

    job: str
    fraction: float
    message: str
    seconds_left: float | None


@dataclass(frozen=True)
class CancelAcknowledged:
    """The engine knows that it should stop; the job's end follows."""


@dataclass(frozen=True)
class RunInfo:
    """A run of the queue. number: counts the runs, and names this one in commands.

    message: what it does, or why it rests or failed. fraction: of the work, 0 to 1.
    expected_bench_seconds, bench_seconds: of the bench's time, `bench_seconds` once it has ended.
    elapsed_seconds, seconds_left: real ones; `seconds_left` is None while nobody can tell.
    pause_requested: whether a person, or a device that failed, wants it to rest until a person
    lets it go on.
    """

    number: int
    title: str
    path: Path
    state: State
    message: str
    stored_frames: int
    planned_frames: int
    fraction: float
    expected_bench_seconds: float
    bench_seconds: float
    elapsed_seconds: float
    seconds_left: float | None
    pause_requested: bool


@dataclass(frozen=True)
class Prompt:
    """What a run asks a person to do. number: counts the prompts."""

    number: int
    text: str


@dataclass(frozen=True)
class QueueState:
    """All runs in their order. hold_reason: why no further run begins, empty while none is held."""

    runs: tuple[RunInfo, ...]
    hold_reason: str = ""
    prompt: Prompt | None = None

    @property
    def current_run(self) -> RunInfo | None:
        return next((run for run in self.runs if run.state.is_under_way), None)

    @property
    def waiting_count(self) -> int:
        """How many runs wait."""
        return sum(run.state is State.WAITING for run in self.runs)

    @property
    def is_busy(self) -> bool:
        """Whether a run has the bench, or is about to."""
        return self.current_run is not None or (self.waiting_count > 0 and not self.hold_reason)


@dataclass(frozen=True)
class RunEnded:
    """How a run ended. path: None if nothing was written. bench_seconds: as in RunInfo."""

    path: Path | None
    state: State
    missing_frames: int
    message: str
    bench_seconds: float = 0.0


@dataclass(frozen=True)
class DeviceReconnected:
    """A device that had failed is open again."""

    device: str


@dataclass(frozen=True, eq=False)
class ReconstructionResult:
    """A photograph before and after, (rows, columns) as a screen shows them, and how it went.

    neutral: the same as it should be, where the run has it; scores: PSNR in dB and SSIM against
    it, before and after. psf: by which it was undone. noise: standard deviation of a pixel, in
    `unit`; noise_source: how it is known, in words. residual: of the photograph, over the noise.
    verdict: on it, in words.
    """

    path: Path
    source: str
    before: NDArray[np.uint8]
    after: NDArray[np.uint8]
    neutral: NDArray[np.uint8] | None
    psf: NDArray[np.float32]
    scores: tuple[tuple[float, float], tuple[float, float]] | None
    method: str
    noise: float
    noise_source: str
    unit: str
    weight: float | None
    iterations: int
    residual: float
    verdict: str
    cpu_seconds: float


@dataclass(frozen=True)
class PictureSaved:
    path: Path


@dataclass(frozen=True)
class JobEnded:
    """A job that leaves nothing behind: it was cancelled, or it failed and said so."""

    job: str


@dataclass(frozen=True)
class FailureReport:
    """Something went wrong, in words that say what to do. device: its name, if it was one."""

    message: str
    device: str = ""


@dataclass(frozen=True)
class OpeningFailed:
    """The bench didn't open, and the engine ends."""

    message: str
