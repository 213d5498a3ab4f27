"""The plan file: what is to be acquired, as data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.file_lookup import find_plan
from labapp.files.pattern_table import Pattern, VideoPattern
from labapp.files.quantities import Finite, Positive
from labapp.files.reading import FileModel, read_file

Names = Annotated[tuple[str, ...], Field(min_length=1)]
Count = Annotated[int, Field(ge=1, le=10_000)]

Axis = Literal["target", "pattern", "wavelength", "exposure", "repeat"]

AXES: tuple[Axis, ...] = ("target", "pattern", "wavelength", "exposure", "repeat")
"""The axes of a block, the slowest to change first unless the block orders them otherwise."""

Role = Literal["light", "dark", "flat", "neutral"]


class PlannedTarget(FileModel):
    """What a plan calls a target, and how it gets before the camera.

    place: its name on the bench; the plan's own if left out. prompt: what a person is asked
    to do first; the run waits for the answer. distance_m: kept for whoever evaluates.
    """

    place: str | None = None
    prompt: str = ""
    distance_m: Positive | None = None


class InterleavedFrames(FileModel):
    """Calibration frames between the frames of a block.

    Before every `every` frames (absent: before the first one only) come `frames` frames of
    each setting that those need: dark, of every exposure; flat, of every wavelength and
    exposure; neutral, of every target, wavelength and exposure. target: "dark" and "flat"
    unless another is named; neutral frames are of the block's own.
    """

    role: Literal["dark", "flat", "neutral"]
    target: str | None = None
    pattern: str = "neutral"
    every: Count | None = None
    frames: Count = 1

    @model_validator(mode="after")
    def _neutral_has_no_target(self) -> InterleavedFrames:
        if self.role == "neutral" and self.target is not None:
            raise ValueError("neutral frames are of the block's own targets; remove 'target'")
        return self


class Acquisition(FileModel):
    """One block: targets x patterns x wavelengths x exposures x repeats.

    slots: of a filter wheel, from 1, instead of wavelengths. periods: exposures as whole
    periods of the block's phase videos, instead of milliseconds. order: axes, the slowest
    first; those left out follow in their usual order. together: groups of axes of the same
    length that step together. any_exposure: a phase video may be cut within its period.
    role: what the block's frames are for, if not pictures of something.
    """

    targets: Names
    patterns: Names
    wavelengths_nm: Annotated[tuple[Positive, ...], Field(min_length=1)] | None = None
    slots: Annotated[tuple[Count, ...], Field(min_length=1)] | None = None
    exposures_ms: Annotated[tuple[Positive, ...], Field(min_length=1)] | None = None
    periods: Annotated[tuple[Count, ...], Field(min_length=1)] | None = None
    repeats: Count = 1
    order: tuple[Axis, ...] = ()
    together: tuple[tuple[Axis, ...], ...] = ()
    any_exposure: bool = False
    interleave: tuple[InterleavedFrames, ...] = ()
    role: Role = "light"

    @model_validator(mode="after")
    def _one_way_each(self) -> Acquisition:
        for one, other in (("wavelengths_nm", "slots"), ("exposures_ms", "periods")):
            if (getattr(self, one) is None) == (getattr(self, other) is None):
                raise ValueError(f"a block has either {one} or {other}")
        return self

    @model_validator(mode="after")
    def _axes_fit(self) -> Acquisition:
        if len(set(self.order)) < len(self.order):
            raise ValueError("order names an axis twice")
        grouped = [axis for group in self.together for axis in group]
        if len(set(grouped)) < len(grouped):
            raise ValueError("together names an axis twice")
        for group in self.together:
            lengths = {axis: self.length(axis) for axis in group}
            if len(group) < 2 or len(set(lengths.values())) > 1:
                listed = ", ".join(f"{axis} {n}" for axis, n in lengths.items())
                raise ValueError(
                    f"axes that step together are two or more and equally long; here: {listed}"
                )
        return self

    def length(self, axis: Axis) -> int:
        """How many values an axis has."""
        values = {
            "target": self.targets,
            "pattern": self.patterns,
            "wavelength": self.wavelengths_nm or self.slots or (),
            "exposure": self.exposures_ms or self.periods or (),
            "repeat": range(self.repeats),
        }
        return len(values[axis])


class Retry(FileModel):
    """What happens when a device fails: so many attempts a frame, so far apart, and then.

    From the second failure on the device is opened again; one that can tell that it was
    unplugged is waited for before that, up to a minute. then: the run fails, and can be
    resumed; or it pauses until somebody has mended the cause.
    """

    attempts: Annotated[int, Field(ge=1, le=100)] = 3
    wait_s: Annotated[float, Field(ge=0, le=3600)] = 0.2
    then: Literal["fail", "pause"] = "fail"


class Reconstruction(FileModel):
    """Which targets and patterns play which part when the pictures are undone.

    wavelength_nm is needed only if the plan has several. iterations: of Richardson-Lucy, at most;
    it ends where no more than noise is left unexplained.
    """

    @property
    def wavelength(self) -> float | None:
        """In metres."""
        return None if self.wavelength_nm is None else self.wavelength_nm * 1e-9

    dark: str = "dark"
    star: str = "star"
    photograph: str = "photograph"
    neutral: str = "neutral"
    coded: str
    wavelength_nm: Positive | None = None
    psf_window_px: Annotated[int, Field(ge=15, le=4096)] = 128
    iterations: Annotated[int, Field(ge=1, le=10_000)] = 120


class PlanFile(FileModel):
    """An acquisition plan; the same plan runs from window, command line and Python.

    targets: by the plan's own names, where the bench's aren't enough. hooks: names of
    entry points in the group "labapp.hooks". metadata: whatever shall be kept with the data.
    """

    version: Literal[1]
    title: str
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    metadata: dict[str, str | int | Finite | bool] = Field(default_factory=dict)
    targets: dict[str, PlannedTarget] = Field(default_factory=dict)
    patterns: Annotated[dict[str, Pattern], Field(min_length=1)]
    acquire: Annotated[tuple[Acquisition, ...], Field(min_length=1)]
    retry: Retry = Retry()
    hooks: tuple[str, ...] = ()
    reconstruct: Reconstruction | None = None

    @model_validator(mode="after")
    def _names_exist(self) -> PlanFile:
        for block in self.acquire:
            for name in (*block.patterns, *(one.pattern for one in block.interleave)):
                self._require_pattern("acquire", name)
        for name, pattern in self.patterns.items():
            for frame in pattern.frames if isinstance(pattern, VideoPattern) else ():
                self._require_pattern(f"pattern {name!r}", frame)
                if isinstance(self.patterns[frame], VideoPattern):
                    raise ValueError(f"pattern {name!r} has the video {frame!r} as a frame")
        return self

    @model_validator(mode="after")
    def _periods_have_videos(self) -> PlanFile:
        for block in self.acquire:
            if block.periods is not None and not self.videos(block):
                raise ValueError("a block with periods needs a pattern of kind 'video'")
        return self

    def videos(self, block: Acquisition) -> dict[str, VideoPattern]:
        """The phase videos among a block's patterns, by name."""
        found = {name: self.patterns[name] for name in block.patterns}
        return {name: one for name, one in found.items() if isinstance(one, VideoPattern)}

    def _require_pattern(self, who: str, name: str) -> None:
        if name not in self.patterns:
            known = ", ".join(self.patterns)
            raise ValueError(f"{who} asks for pattern {name!r}, and the patterns are {known}")


@dataclass(frozen=True)
class NamedPlan:
    """A plan, the name or path that somebody gave for it, and its file."""

    name: Path
    path: Path
    plan: PlanFile


def read_plan(name: Path) -> NamedPlan:
    """The plan of a file, or a ready one by its name; UserError says what is wrong."""
    path = find_plan(name)
    return NamedPlan(name, path, read_file(path, PlanFile))
