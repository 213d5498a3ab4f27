"""What the window and its engine say to each other. SI units; nothing heavy is imported."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.window.bracket import Bracket

PatternTable = dict[str, Any]
"""A pattern as a plan file writes it: its kind, and the keys of that kind."""


# From the window to the engine.


@dataclass(frozen=True)
class SetLive:
    """Take one picture after the other, or stop."""

    on: bool


@dataclass(frozen=True)
class Place:
    target: str


@dataclass(frozen=True)
class Tune:
    """wavelength: metres."""

    wavelength: float


@dataclass(frozen=True)
class Expose:
    """exposure: seconds."""

    exposure: float


@dataclass(frozen=True)
class Preview:
    """Compute a pattern and the PSF that it gives at a wavelength in metres."""

    pattern: PatternTable
    wavelength: float


@dataclass(frozen=True)
class Show:
    """Compute a pattern and put it on the SLM."""

    pattern: PatternTable


@dataclass(frozen=True)
class Acquire:
    """Take a bracket of the star and of the photograph into the record at `path`."""

    pattern: PatternTable
    wavelength: float
    star: Bracket
    photograph: Bracket
    path: Path


@dataclass(frozen=True)
class Reconstruct:
    path: Path


@dataclass(frozen=True)
class Cancel:
    """Stop the work that is under way."""


@dataclass(frozen=True)
class FrameSeen:
    """The window has taken a frame in and has room for the next."""


Command = (
    SetLive | Place | Tune | Expose | Preview | Show | Acquire | Reconstruct | Cancel | FrameSeen
)


# From the engine to the window.


@dataclass(frozen=True)
class DeviceInfo:
    """A device of the bench: what it is, how it is, and the last value read from it."""

    name: str
    model: str
    simulated: bool
    state: str = "ready"
    value: str = ""


@dataclass(frozen=True)
class BenchOpened:
    """What the bench can do. Ranges in metres and seconds; shapes are (rows, columns)."""

    name: str
    devices: tuple[DeviceInfo, ...]
    targets: tuple[str, ...]
    wavelength_range: tuple[float, float]
    exposure_range: tuple[float, float]
    camera_shape: tuple[int, int]
    full_scale: int


@dataclass(frozen=True)
class BenchState:
    """What the devices are really set to, read back from them."""

    devices: tuple[DeviceInfo, ...]
    target: str
    pattern: str
    wavelength: float
    exposure: float
    live: bool


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A raw picture, and everything that it was really taken with."""

    image: NDArray[np.uint16]
    target: str
    pattern: str
    wavelength: float
    exposure: float
    number: int


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
class CancelHeard:
    """The engine knows that it should stop; the job's end follows."""


@dataclass(frozen=True)
class RunEnded:
    """How a run ended. path: None if nothing was written."""

    path: Path | None
    state: str
    missing: int
    message: str


@dataclass(frozen=True, eq=False)
class Reconstructed:
    """Pictures by name, the measured PSF, and (PSNR in dB, SSIM) by name."""

    path: Path
    images: dict[str, NDArray[np.float32]]
    psf: NDArray[np.float32]
    scores: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class JobEnded:
    """A job that leaves nothing behind: it was cancelled, or it failed and said so."""

    job: str


@dataclass(frozen=True)
class Failure:
    """Something went wrong, in words that say what to do. device: its name, if it was one."""

    message: str
    device: str = ""


@dataclass(frozen=True)
class OpeningFailed:
    """The bench didn't open, and the engine ends."""

    message: str


Report = (
    BenchOpened
    | BenchState
    | LiveFrame
    | PatternPreview
    | JobProgress
    | CancelHeard
    | RunEnded
    | Reconstructed
    | JobEnded
    | Failure
    | OpeningFailed
)
