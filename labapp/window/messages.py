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
    """Describe a device of the bench to the window: its model, its state and its last value.

    `error` says what is wrong with the device if its state is "failed" or "unplugged".
    """

    name: str
    model: str
    simulated: bool
    state: str = "ready"
    value: str = ""
    error: str = ""


@dataclass(frozen=True)
class BenchOpened:
    """Tell the window what the bench can do, after the bench was opened.

    Ranges are in metres and seconds, shapes are (rows, columns), and `full_scale` is in DN.
    `virtual` tells whether the bench's clock takes no real time. `scene_tolerance` is the relative
    error of simulated pictures, and None where the camera is real. `targets_by_hand` tells whether
    a person places the targets.
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
    """Tell the window the devices' settings as read back; for a dead device, the last known one.

    `wavelength` is in metres, `exposure` in seconds. `live` tells whether live view is running,
    `in_run` whether a run is under way, and `waiting` whether it waits for a person, who may set
    exposure and live view meanwhile.
    `target` is empty as long as a person has confirmed none, and `target_doubt` says how the first
    picture after that doesn't fit the target. `pattern_number` counts the patterns
    that the window has shown, from 0 for the one at the opening.
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
        """Return the names of the bench's devices that the window shows as failed or unplugged."""
        return {device.name for device in self.devices if device.error}


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """Hold a raw picture in DN, with the settings that it was really taken with."""

    image: NDArray[np.uint16]
    target: str
    pattern: str
    wavelength: float
    exposure: float
    number: int


@dataclass(frozen=True, eq=False)
class LivePicture:
    """Send the window what it shows of a frame, and the frame itself.

    Arrays are views of memory that the engine writes again once the window has acknowledged a
    later frame; who keeps one copies it.

    Attributes
    ----------
    frame : LiveFrame
        The raw frame.
    shown : ReducedFrame
        The part that the window shows, as its screen shows it.
    request : int
        Number of the person's last change of a setting that the frame was taken after.
    dropped, missed : int
        Frames since live view began that were taken but not shown, and that the camera counted
        but didn't deliver.
    is_prediction : bool
        Whether no camera took the frame: it is a coarse prediction, shown until the exact picture
        is simulated.
    """

    frame: LiveFrame
    shown: ReducedFrame
    request: int = 0
    dropped: int = 0
    missed: int = 0
    is_prediction: bool = False


@dataclass(frozen=True)
class PictureAwaited:
    """Tell the window that its picture isn't that of the settings any more, and what is done.

    Attributes
    ----------
    request : int
        Number of the person's last change of a setting. Pictures of it and of later ones are
        what the window waits for.
    activity : str
        What is done for the picture, such as "computing the picture".
    elapsed : float
        Seconds since the change.
    seconds_left : float or None
        Seconds until the picture is expected; None if that isn't known.
    """

    request: int
    activity: str
    elapsed: float
    seconds_left: float | None


@dataclass(frozen=True)
class EffectInfo:
    """Tell the window at which level the simulator computes an effect in a picture, and why.

    Attributes
    ----------
    name : str
        The effect.
    level : str
        The effect's level as text.
    on : bool
        Whether the effect takes part.
    forced : bool
        Whether the scene file prescribes the level.
    error : float or None
        Change of the picture between this level and the finest, relative to the picture: at most,
        or likely. None if it isn't known.
    error_estimate : float
        Typical value of that change.
    why : str
        The reason for the level: how much of the effect there is in this picture.
    physics : str
        What the effect does to the light or to the picture.
    source : str
        Reference for the effect's model.
    error_source : str
        Where the error comes from.
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
    """Tell the window what the simulator computes for pictures at these settings.

    Attributes
    ----------
    target, pattern : str
        Names of the target and of the pattern on the SLM.
    wavelength, exposure : float
        Wavelength in metres and exposure time in seconds.
    effects : tuple of EffectInfo
        The effects in the order in which they act on the light.
    tol : float
        The tolerance: the picture's relative error that all levels together may cause.
    error : float or None
        The picture's relative difference from one with all effects at their finest: at most, or
        likely. None if it isn't known.
    work : float
        Work for the picture, as a share of the work with all effects at their finest.
    is_estimated : bool
        Whether estimates decided, so that all errors are likely ones; else they are bounds.
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
    """Send the window a pattern's grey levels at reduced size, and its PSF on sensor pixels.

    The PSF is scaled to a peak of 1; `peak` is the share of the light in its brightest pixel.
    """

    pattern: PatternTable
    name: str
    grey: NDArray[np.uint8]
    psf: NDArray[np.float32]
    peak: float


@dataclass(frozen=True)
class JobProgress:
    """Tell the window the progress of a job of the engine.

    `fraction` is from 0 to 1; `seconds_left` is None as long as it can't be estimated.
    """

    job: str
    fraction: float
    message: str
    seconds_left: float | None


@dataclass(frozen=True)
class CancelAcknowledged:
    """Tell the window that the engine has received Cancel; the end of the job or run follows."""


@dataclass(frozen=True)
class RunInfo:
    """Describe a run of the engine's queue to the window.

    Attributes
    ----------
    number : int
        Counts the runs, and identifies this one in commands.
    title : str
        Title of the run's plan.
    path : Path
        The run's record.
    state : State
        State of the run.
    message : str
        What the run is doing, or why it is paused or failed.
    stored_frames, planned_frames : int
        Frames that the record has, and frames of the plan.
    fraction : float
        Share of the work that is done, from 0 to 1.
    expected_bench_seconds : float
        Time on the bench's clock that the run is expected to take.
    bench_seconds : float
        Time on the bench's clock that the run took, 0 until it has ended.
    elapsed_seconds : float
        Real time that the run has taken.
    seconds_left : float or None
        Real time that is left; None if the run has ended, or nothing like it was measured yet.
    pause_requested : bool
        Whether a person or a failed device asks for a pause that lasts until a person ends it.
    ticket : str
        Ticket of the request that the run was made for.
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
    """Ask a person at the window to do something for a run; `number` counts the prompts.

    `done` is the answer that Enter gives, and `alternative` another one, if there is one.
    """

    number: int
    text: str
    done: str = "Done"
    alternative: str = ""


@dataclass(frozen=True)
class QueueState:
    """Tell the window all runs of the queue in their order.

    `hold_reason` says why no further run begins; it is empty while no run is held back. `prompt`
    is the prompt that a run is waiting for.
    """

    runs: tuple[RunInfo, ...]
    hold_reason: str = ""
    prompt: Prompt | None = None

    @property
    def current_run(self) -> RunInfo | None:
        return next((run for run in self.runs if run.state.is_under_way), None)

    @property
    def waiting_count(self) -> int:
        """Return how many runs of the window's queue are waiting."""
        return sum(run.state is State.WAITING for run in self.runs)

    @property
    def is_busy(self) -> bool:
        """Return whether a run of the window's queue is using the bench, or is about to."""
        return self.current_run is not None or (self.waiting_count > 0 and not self.hold_reason)


@dataclass(frozen=True)
class RunEnded:
    """Tell the window how a run ended; `path` is the record, None if nothing was written.

    `bench_seconds` is the time that the run took on the bench's clock.
    """

    path: Path | None
    state: State
    missing_frames: int
    message: str
    bench_seconds: float = 0.0


@dataclass(frozen=True)
class RequestRefused:
    """Tell the window that no run was queued for a request; a FailureReport says why."""

    ticket: str


@dataclass(frozen=True)
class DeviceReconnected:
    """Tell the window that a failed device of the bench is open again."""

    device: str


@dataclass(frozen=True, eq=False)
class RecordOpened:
    """Tell the window what a record holds, and whether its photograph can be restored.

    Attributes
    ----------
    path : Path
        The record.
    summary, frame : str
        What the record holds, and which of its frames `picture` is.
    picture : ndarray of uint8, shape (rows, columns), or None
        A raw frame with the grey values of a screen; None if the record has none.
    why_not_restored : str
        Why the photograph can't be restored as it is; empty if it can.
    """

    path: Path
    summary: str
    frame: str
    picture: NDArray[np.uint8] | None
    why_not_restored: str


@dataclass(frozen=True, eq=False)
class ReconstructionResult:
    """Send the window a photograph before and after restoration, with figures on its quality.

    Attributes
    ----------
    path : Path
        The record that the photograph is from.
    source : str
        The photograph's name within the record.
    before, after : ndarray of uint8, shape (rows, columns) or (rows, columns, 3)
        The photograph and the restored picture, with the values of a screen: grey, or sRGB.
    neutral : ndarray of uint8, of the same shape, or None
        The photograph taken with the neutral pattern, if the record has it.
    psf : ndarray of float32, shape (rows, columns)
        The PSF that the restoration used.
    scores : tuple of two tuples, or None
        PSNR in dB and SSIM against the neutral photograph, before and after restoration.
    method : str
        The restoration method.
    noise : float
        Standard deviation of a pixel's noise, in `unit`.
    noise_source : str
        How the noise is known, in words.
    unit : str
        Unit of the noise.
    weight : float or None
        Regularisation weight.
    iterations : int or None
        Iterations of the solver; None for a decoder.
    residual : float or None
        The photograph less the blurred estimate, rms, over the noise; None for a decoder, which
        doesn't know the depth by which to blur.
    verdict : str
        Judgement of the residual, in words; remarks on the photograph for a decoder.
    cpu_seconds : float
        Processor time of the restoration.
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
    """Tell the window what a method's account predicts for a PSF at a tolerance.

    Attributes
    ----------
    method : str
        The method.
    tol : float
        The tolerance that is asked for.
    error : float or None
        Predicted relative error; None if the method refuses.
    first_seconds, each_seconds : float or None
        Predicted processor time of the first answer, planning included, and of each further one.
    memory : int or None
        Bytes.
    chosen : bool
        Whether the method is the automatic choice for the tolerance.
    on_front : bool
        Whether no other point is both faster and more exact.
    failure : str
        Why the method refuses; empty if it doesn't.
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
    """Tell the window what a tolerance costs in a live picture of the virtual bench.

    `error` is the likely relative error, and None if it isn't known. `seconds` is processor time.
    """

    tol: float
    error: float | None
    seconds: float


@dataclass(frozen=True)
class AccuracyForecast:
    """Tell the window what each tolerance costs; `live` is empty where the camera is real.

    `wavelength` is in metres.
    """

    wavelength: float
    tolerances: tuple[float, ...]
    points: tuple[AccuracyPoint, ...]
    live: tuple[LivePrediction, ...]

    def chosen_point(self, tol: float) -> AccuracyPoint | None:
        """Return the automatic choice that the window shows for a tolerance; None if all refuse."""
        return next((one for one in self.points if one.chosen and one.tol == tol), None)

    def failure(self, tol: float) -> str:
        """Return why no method that the window could show keeps a tolerance."""
        return next((o.failure for o in reversed(self.points) if o.tol == tol and o.failure), "")


@dataclass(frozen=True)
class AccuracyMeasured:
    """Tell the window that the accuracy page is written, with how many of all operations.

    `cancelled` tells whether a person stopped it; otherwise the page says what it lacks and why.
    """

    page: Path
    measured: int
    operations: int
    cancelled: bool


@dataclass(frozen=True)
class PictureSaved:
    """Tell the window that the restored photograph was saved."""

    path: Path


@dataclass(frozen=True)
class JobEnded:
    """Tell the window that a job of the engine is over: finished, cancelled or failed."""

    job: str


@dataclass(frozen=True)
class FailureReport:
    """Tell the window what went wrong and what to do; `device` names the device that failed."""

    message: str
    device: str = ""


@dataclass(frozen=True)
class OpeningFailed:
    """Tell the window that the bench couldn't be opened and that the engine ends."""

    message: str
