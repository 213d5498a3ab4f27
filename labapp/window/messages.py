"""The messages that the engine process sends to its window, in SI units.

Both processes import this module, so it imports nothing heavy.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.runs.state import State
from labapp.window.commands import PatternTable
from labapp.window.frame_reduction import ReducedFrame


@dataclass(frozen=True)
class DeviceInfo:
    """A device's model, state and last value; `error` says why it has failed or is unplugged."""

    name: str
    model: str
    simulated: bool
    state: str = "ready"
    value: str = ""
    error: str = ""


@dataclass(frozen=True)
class BenchOpened:
    """What the bench can do, told once it is open.

    wavelength_range: m.
    exposure_range: s.
    camera_shape: (rows, columns).
    full_scale: DN.
    virtual: whether the bench's clock takes no real time.
    scene_tolerance: relative error of simulated pictures; None where the camera is real.
    targets_by_hand: whether a person places the targets.
    """

    name: str
    devices: tuple[DeviceInfo, ...]
    targets: tuple[str, ...]
    wavelength_range: tuple[float, float]
    exposure_range: tuple[float, float]
    camera_shape: tuple[int, int]
    full_scale: int
    virtual: bool
    scene_tolerance: float | None = None
    targets_by_hand: bool = False


@dataclass(frozen=True)
class BenchState:
    """The devices' settings as read back; for a dead device, the last known one.

    target: empty as long as a person has confirmed none.
    wavelength: m.
    exposure: s.
    live: whether live view is running.
    in_run: whether a run is under way.
    waiting: whether that run waits for a person, who may set exposure and live view meanwhile.
    target_doubt: how the first picture after a person confirmed the target doesn't fit it.
    pattern_number: counts the patterns that were shown, from 0 for the one at the opening.
    """

    devices: tuple[DeviceInfo, ...]
    target: str
    pattern: str
    wavelength: float
    exposure: float
    live: bool
    in_run: bool = False
    waiting: bool = False
    pattern_number: int = 0
    target_doubt: str = ""

    @property
    def failed_devices(self) -> set[str]:
        """Return the names of the devices that have failed or are unplugged."""
        return {device.name for device in self.devices if device.error}


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A raw picture in DN, with the settings that it was really taken with."""

    image: NDArray[np.uint16]
    target: str
    pattern: str
    wavelength: float
    exposure: float
    number: int


@dataclass(frozen=True, eq=False)
class LivePicture:
    """What is shown of a frame, and the frame itself.

    Arrays are views of memory that the engine writes again once the window has acknowledged a later
    frame; who keeps one copies it.

    frame: raw.
    shown: the visible part, as the screen shows it.
    request: number of the person's last change of a setting that the frame was taken after.
    dropped, missed: frames since live view began that were taken but not shown, and that the camera
        counted but didn't deliver.
    is_prediction: whether no camera took the frame: it is a coarse prediction, shown until the
        exact picture is simulated.
    """

    frame: LiveFrame
    shown: ReducedFrame
    request: int = 0
    dropped: int = 0
    missed: int = 0
    is_prediction: bool = False


@dataclass(frozen=True)
class PictureAwaited:
    """Tell that the picture isn't that of the settings any more, and what is done.

    request: number of the person's last change of a setting; pictures of it and of later ones are
        what the window waits for.
    activity: what is done for the picture, such as "computing the picture".
    elapsed: seconds since the change.
    seconds_left: until the picture is expected; None if that isn't known.
    """

    request: int
    activity: str
    elapsed: float
    seconds_left: float | None


@dataclass(frozen=True)
class EffectInfo:
    """The level at which the simulator computes an effect in a picture, and why.

    on: whether the effect takes part.
    forced: whether the scene file prescribes the level.
    error: change of the picture between this level and the finest, relative to the picture: at
        most, or likely. None if it isn't known.
    error_estimate: typical value of that change.
    why: reason for the level: how much of the effect there is in this picture.
    physics: what the effect does to the light or to the picture.
    source: reference for the effect's model.
    error_source: where the error comes from.
    """

    name: str
    level: str
    on: bool
    forced: bool
    error: float | None
    error_estimate: float
    why: str
    physics: str
    source: str
    error_source: str


@dataclass(frozen=True)
class EffectsReport:
    """What the simulator computes for pictures at these settings.

    target, pattern: names, the second of the pattern on the SLM.
    wavelength: m.
    exposure: s.
    effects: in the order in which they act on the light.
    tol: tolerance, the picture's relative error that all levels together may cause.
    error: the picture's relative difference from one with all effects at their finest: at most, or
        likely. None if it isn't known.
    work: for the picture, as a share of the work with all effects at their finest.
    is_estimated: whether estimates decided, so that all errors are likely ones; else they are
        bounds.
    """

    target: str
    pattern: str
    wavelength: float
    exposure: float
    effects: tuple[EffectInfo, ...]
    tol: float
    error: float | None
    work: float
    is_estimated: bool = False


@dataclass(frozen=True, eq=False)
class PatternPreview:
    """A pattern's grey levels at reduced size, and its PSF on sensor pixels.

    psf: scaled to a peak of 1.
    peak: share of the light in the PSF's brightest pixel.
    """

    pattern: PatternTable
    name: str
    grey: NDArray[np.uint8]
    psf: NDArray[np.float32]
    peak: float


@dataclass(frozen=True)
class JobProgress:
    """How far a job of the engine is.

    fraction: 0 to 1.
    seconds_left: None as long as it can't be estimated.
    """

    job: str
    fraction: float
    message: str
    seconds_left: float | None


@dataclass(frozen=True)
class CancelAcknowledged:
    """The engine has received Cancel; the end of the job or run follows."""


@dataclass(frozen=True)
class RunInfo:
    """The state of one run of the queue.

    number: counts the runs, and identifies this one in commands.
    title: that of the run's plan.
    path: the run's record.
    message: what the run is doing, or why it is paused or failed.
    stored_frames, planned_frames: frames that the record has, and frames of the plan.
    fraction: share of the work that is done, 0 to 1.
    expected_bench_seconds: time on the bench's clock that the run is expected to take.
    bench_seconds: time on the bench's clock that the run took, 0 until it has ended.
    elapsed_seconds: real time that the run has taken.
    seconds_left: real time; None if the run has ended, or nothing like it was measured yet.
    pause_requested: whether a person or a failed device asks for a pause that lasts until a person
        ends it.
    ticket: that of the request that the run was made for.
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
    ticket: str = ""


@dataclass(frozen=True)
class Prompt:
    """What a run asks a person to do.

    number: counts the prompts.
    done: the answer that Enter gives.
    alternative: another answer, if there is one.
    """

    number: int
    text: str
    done: str = "Done"
    alternative: str = ""


@dataclass(frozen=True)
class QueueState:
    """All runs of the queue in their order.

    hold_reason: why no further run begins; empty while no run is held back.
    prompt: what a run is waiting for.
    """

    runs: tuple[RunInfo, ...]
    hold_reason: str = ""
    prompt: Prompt | None = None

    @property
    def current_run(self) -> RunInfo | None:
        return next((run for run in self.runs if run.state.is_under_way), None)

    @property
    def waiting_count(self) -> int:
        """Return how many runs are waiting."""
        return sum(run.state is State.WAITING for run in self.runs)

    @property
    def is_busy(self) -> bool:
        """Return whether a run is using the bench, or is about to."""
        return self.current_run is not None or (self.waiting_count > 0 and not self.hold_reason)


@dataclass(frozen=True)
class RunEnded:
    """How a run ended.

    path: the record; None if nothing was written.
    bench_seconds: time that the run took on the bench's clock.
    """

    path: Path | None
    state: State
    missing_frames: int
    message: str
    bench_seconds: float = 0.0


@dataclass(frozen=True)
class RequestRefused:
    """No run was queued for a request; a FailureReport says why."""

    ticket: str


@dataclass(frozen=True)
class DeviceReconnected:
    """A failed device is open again."""

    device: str


@dataclass(frozen=True, eq=False)
class RecordOpened:
    """What a record holds, and whether its photograph can be restored.

    path: the record.
    summary: what the record holds.
    frame: which of its frames `picture` is.
    picture: raw frame with the grey values of a screen, (rows, columns) uint8; None if the record
        has none.
    why_not_restored: why the photograph can't be restored as it is; empty if it can.
    """

    path: Path
    summary: str
    frame: str
    picture: NDArray[np.uint8] | None
    why_not_restored: str


@dataclass(frozen=True, eq=False)
class ReconstructionResult:
    """A photograph before and after restoration, with figures on its quality.

    path: the record that the photograph is from.
    source: the photograph's name within the record.
    before, after: photograph and restored picture with the values of a screen: grey, (rows,
        columns) uint8, or sRGB, (rows, columns, 3).
    neutral: photograph taken with the neutral pattern, of the same shape, if the record has it.
    psf: what the restoration used, (rows, columns).
    scores: PSNR in dB and SSIM against the neutral photograph, before and after restoration.
    noise: standard deviation of a pixel's noise, in `unit`.
    noise_source: how the noise is known, in words.
    weight: regularisation weight.
    iterations: of the solver; None for a decoder.
    residual: the photograph less the blurred estimate, rms, over the noise; None for a decoder,
        which doesn't know the depth by which to blur.
    verdict: judgement of the residual, in words; remarks on the photograph for a decoder.
    cpu_seconds: processor time of the restoration.
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
    iterations: int | None
    residual: float | None
    verdict: str
    cpu_seconds: float


@dataclass(frozen=True)
class AccuracyPoint:
    """What a method's account predicts for a PSF at a tolerance.

    tol: the tolerance that is asked for.
    error: predicted relative error; None if the method refuses.
    first_seconds, each_seconds: predicted processor time of the first answer, planning included,
        and of each further one.
    memory: bytes.
    chosen: whether the method is the automatic choice for the tolerance.
    on_front: whether no other point is both faster and more exact.
    failure: why the method refuses; empty if it doesn't.
    """

    method: str
    tol: float
    error: float | None
    first_seconds: float | None
    each_seconds: float | None
    memory: int | None
    chosen: bool
    on_front: bool
    failure: str


@dataclass(frozen=True)
class LivePrediction:
    """What a tolerance costs in a live picture of the virtual bench.

    error: likely relative error; None if it isn't known.
    seconds: processor time.
    """

    tol: float
    error: float | None
    seconds: float


@dataclass(frozen=True)
class AccuracyForecast:
    """What each tolerance costs.

    wavelength: m.
    live: empty where the camera is real.
    """

    wavelength: float
    tolerances: tuple[float, ...]
    points: tuple[AccuracyPoint, ...]
    live: tuple[LivePrediction, ...]

    def chosen_point(self, tol: float) -> AccuracyPoint | None:
        """Return the automatic choice for a tolerance; None if all methods refuse."""
        return next((one for one in self.points if one.chosen and one.tol == tol), None)

    def failure(self, tol: float) -> str:
        """Return why no method keeps a tolerance."""
        return next((o.failure for o in reversed(self.points) if o.tol == tol and o.failure), "")


@dataclass(frozen=True)
class AccuracyMeasured:
    """The accuracy page is written, with how many of all operations.

    cancelled: whether a person stopped it; otherwise the page says what it lacks and why.
    """

    page: Path
    measured: int
    operations: int
    cancelled: bool


@dataclass(frozen=True)
class PictureSaved:
    """The restored photograph was saved."""

    path: Path


@dataclass(frozen=True)
class JobEnded:
    """A job of the engine is over: finished, cancelled or failed."""

    job: str


@dataclass(frozen=True)
class FailureReport:
    """What went wrong and what to do; `device` names the device that failed."""

    message: str
    device: str = ""


@dataclass(frozen=True)
class OpeningFailed:
    """The bench couldn't be opened, and the engine ends."""

    message: str
