"""The plan file: targets, patterns, wavelengths and exposures of an acquisition."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from labapp.files.bracket_table import BracketTable, ChosenTable
from labapp.files.file_lookup import find_plan
from labapp.files.pattern_table import Pattern, VideoPattern
from labapp.files.quantities import Finite, Nanometres, Positive
from labapp.files.reading import FileModel, read_file

Names = Annotated[tuple[str, ...], Field(min_length=1)]
Count = Annotated[int, Field(ge=1, le=10_000)]
Binning = Annotated[int, Field(ge=1, le=64)]

Axis = Literal["target", "pattern", "wavelength", "region", "binning", "gain", "exposure", "repeat"]

MOST_FRAMES = 2_000_000
"""Frames of a plan: some seconds of processor time to list them, and 0.1 GB. Chosen."""

AXES: tuple[Axis, ...] = get_args(Axis)
"""The axes of an acquisition block in their usual order, the slowest to change first."""

MOST_AVERAGED = 65_536
"""Frames whose mean may be stored: their sum is a number of 32 bits."""

_Decibels = Annotated[float, Field(ge=-1000, le=1000)]

_MOST_READOUTS = 10_000
"""Regions times binnings times gains of a block. Chosen."""

_Region = tuple[
    Annotated[int, Field(ge=0)],
    Annotated[int, Field(ge=0)],
    Annotated[int, Field(ge=1)],
    Annotated[int, Field(ge=1)],
]
"""x, y, width and height in pixels."""

Role = Literal["light", "dark", "flat", "neutral"]

ROLES: tuple[Role, ...] = get_args(Role)


class PlannedTarget(FileModel):
    """A target as a plan file names it, and how it is placed before the camera.

    place is the target's name on the bench, by default the plan's name. prompt is what a person
    is asked to do before the target is placed; the run waits for the answer. distance_m is only
    recorded, for the evaluation.
    """

    place: str | None = None
    prompt: str = ""
    distance_m: Positive | None = None


class InterleavedFrames(FileModel):
    """Calibration frames between the frames of an acquisition block.

    They are taken before every group of `every` frames, or before the first frame only if `every`
    is absent. Each needed setting is taken `frames` times. Dark frames are needed for every
    exposure of the group, flat frames for every wavelength and exposure, neutral frames for every
    target, wavelength and exposure. target is "dark" or "flat" unless it is given; neutral
    frames have the block's own targets.
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
    """One block of a plan: all combinations of the values of its axes.

    slots are those of a filter wheel, from 1, instead of wavelengths. regions_px are the parts of
    the camera's frames that are read, each x, y, width and height; binnings the pixels each way
    whose mean is one; gains_db those of the camera. Without a key, the camera stays as the bench
    opens it. Instead of milliseconds, exposures are `periods` of the block's videos, or chosen for
    the ratio of a `bracket`; `chosen` says why, in the plan of a record. average is the number of
    frames whose mean is stored as one. order names the axes, the slowest first, before the others
    in their usual order; axes in a group of `together` have the same length and step together. With
    any_exposure, an exposure may end within the period of a video, or of a lamp's flicker. role is
    "light" for pictures of a target, else the kind of calibration frame.
    """

    targets: Names
    patterns: Names
    wavelengths_nm: Annotated[tuple[Nanometres, ...], Field(min_length=1)] | None = None
    slots: Annotated[tuple[Count, ...], Field(min_length=1)] | None = None
    regions_px: Annotated[tuple[_Region, ...], Field(min_length=1)] | None = None
    binnings: Annotated[tuple[Binning, ...], Field(min_length=1)] | None = None
    gains_db: Annotated[tuple[_Decibels, ...], Field(min_length=1)] | None = None
    exposures_ms: Annotated[tuple[Positive, ...], Field(min_length=1)] | None = None
    periods: Annotated[tuple[Count, ...], Field(min_length=1)] | None = None
    bracket: BracketTable | None = None
    chosen: ChosenTable | None = None
    repeats: Count = 1
    average: Annotated[int, Field(ge=1, le=MOST_AVERAGED)] = 1
    order: tuple[Axis, ...] = ()
    together: tuple[tuple[Axis, ...], ...] = ()
    any_exposure: bool = False
    interleave: tuple[InterleavedFrames, ...] = ()
    role: Role = "light"

    @model_validator(mode="after")
    def _one_way_each(self) -> Acquisition:
        if (self.wavelengths_nm is None) == (self.slots is None):
            raise ValueError("a block has either wavelengths_nm or slots")
        if sum(one is not None for one in (self.exposures_ms, self.periods, self.bracket)) != 1:
            raise ValueError("a block has either exposures_ms, periods or bracket")
        return self

    @model_validator(mode="after")
    def _readouts_fit(self) -> Acquisition:
        readouts = prod(self.length(axis) for axis in ("region", "binning", "gain"))
        if readouts > _MOST_READOUTS:
            raise ValueError(
                f"a block reads the camera in {readouts:,} ways, and {_MOST_READOUTS:,} are "
                "possible; split it"
            )
        if self.bracket is not None and (readouts > 1 or self.average > 1):
            raise ValueError(
                "the exposures of a bracket are chosen for one region, binning and gain, and for "
                "single frames; give a block for each, or exposures_ms"
            )
        return self

    @model_validator(mode="after")
    def _axes_fit(self) -> Acquisition:
        if len(set(self.order)) < len(self.order):
            raise ValueError("order names an axis twice")
        grouped = [axis for group in self.together for axis in group]
        if len(set(grouped)) < len(grouped):
            raise ValueError("together names an axis twice")
        for group in self.together:
            if self.bracket is not None and "exposure" in group:
                raise ValueError(
                    "the exposures of a bracket can't step together with another axis, since their "
                    "number is chosen later; give exposures_ms"
                )
            lengths = {axis: self.length(axis) for axis in group}
            if len(group) < 2 or len(set(lengths.values())) > 1:
                listed = ", ".join(f"{axis} {n}" for axis, n in lengths.items())
                raise ValueError(
                    f"axes that step together are two or more and equally long; here: {listed}"
                )
        return self

    def length(self, axis: Axis) -> int:
        """Return the number of values that an axis has."""
        values = {
            "target": self.targets,
            "pattern": self.patterns,
            "wavelength": self.wavelengths_nm or self.slots or (),
            "region": self.regions_px or (None,),
            "binning": self.binnings or (None,),
            "gain": self.gains_db or (None,),
            "exposure": self.exposures_ms or self.periods or (),
            "repeat": range(self.repeats),
        }
        return len(values[axis])

    def frame_limit(self) -> int:
        """Return how many frames there are at most: with those in between, a few too many."""
        axes = {axis: self.length(axis) for axis in AXES}
        if self.bracket is not None:
            axes["exposure"] = self.bracket.most_frames
        beside = {axis for group in self.together for axis in group[1:]}
        light = prod(count for axis, count in axes.items() if axis not in beside)
        exposures = prod(axes[axis] for axis in ("region", "binning", "gain", "exposure"))
        colours = axes["wavelength"] * exposures
        settings = {"dark": exposures, "flat": colours, "neutral": axes["target"] * colours}
        total = light
        for one in self.interleave:
            size = min(one.every or light, light)
            total += -(-light // size) * min(settings[one.role], size) * one.frames
        return total


class Retry(FileModel):
    """How a run reacts to a failing device: `attempts` per frame, `wait_s` apart, then `then`.

    From the second failure on, the device is opened again. If the device reports that it was
    unplugged, the run first waits up to a minute for it to come back. After the last attempt, the
    run fails and can be resumed later ("fail"), or pauses until somebody lets it go on ("pause").
    """

    attempts: Annotated[int, Field(ge=1, le=100)] = 3
    wait_s: Annotated[float, Field(ge=0, le=3600)] = 0.2
    then: Literal["fail", "pause"] = "fail"


class Reconstruction(FileModel):
    """The plan's targets and patterns that a reconstruction of its photograph uses.

    dark, star and photograph are targets; neutral and coded are patterns. wavelength_nm is needed
    only if the plan has several. iterations is the largest number of Richardson-Lucy iterations,
    which end earlier when the residual is down to the noise. grey is for light of one colour on a
    sensor with colour filters: its photograph is restored as one band.
    """

    @property
    def wavelength(self) -> float | None:
        """Wavelength of the frames to use, metres; None stands for the plan's only one."""
        return None if self.wavelength_nm is None else self.wavelength_nm * 1e-9

    dark: str = "dark"
    star: str = "star"
    photograph: str = "photograph"
    neutral: str = "neutral"
    coded: str
    wavelength_nm: Nanometres | None = None
    psf_window_px: Annotated[int, Field(ge=15, le=4096)] = 128
    iterations: Annotated[int, Field(ge=1, le=10_000)] = 120
    grey: bool = False


class PlanFile(FileModel):
    """A plan of an acquisition, which can be run from the window, the command line and Python.

    targets is needed only for targets whose names or prompts differ from the bench's. hooks are
    names of entry points in the group "labapp.hooks". metadata is kept with the data.
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
    def _fits_together(self) -> PlanFile:
        for block in self.acquire:
            for name in (*block.patterns, *(one.pattern for one in block.interleave)):
                self._require_pattern("acquire", name)
        for name, pattern in self.patterns.items():
            for frame in pattern.frames if isinstance(pattern, VideoPattern) else ():
                self._require_pattern(f"pattern {name!r}", frame)
                if isinstance(self.patterns[frame], VideoPattern):
                    raise ValueError(f"pattern {name!r} has the video {frame!r} as a frame")
        count = sum(block.frame_limit() for block in self.acquire)
        if count > MOST_FRAMES:
            raise ValueError(
                f"the plan has up to {count:,} frames, and a record at most {MOST_FRAMES:,}; split "
                "the plan"
            )
        for block in self.acquire:
            if block.periods is not None and not self.videos(block):
                raise ValueError("a block with periods needs a pattern of kind 'video'")
        return self

    @property
    def has_brackets(self) -> bool:
        """Whether exposures are still to be chosen."""
        return any(block.bracket is not None for block in self.acquire)

    def videos(self, block: Acquisition) -> dict[str, VideoPattern]:
        """Return the videos among a block's patterns, by name."""
        found = {name: self.patterns[name] for name in block.patterns}
        return {name: one for name, one in found.items() if isinstance(one, VideoPattern)}

    def _require_pattern(self, who: str, name: str) -> None:
        if name not in self.patterns:
            known = ", ".join(self.patterns)
            raise ValueError(f"{who} asks for pattern {name!r}, and the patterns are {known}")


@dataclass(frozen=True)
class NamedPlan:
    """A plan, where it was read, and the name or path that the user gave."""

    name: Path
    path: Path
    plan: PlanFile


def read_plan(name: Path) -> NamedPlan:
    """Read a plan, given its path or a bundled one's name; raise UserError if it is wrong."""
    path = find_plan(name)
    return NamedPlan(name, path, read_file(path, PlanFile))
