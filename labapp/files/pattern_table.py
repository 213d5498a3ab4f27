"""The patterns of a plan file: what the SLM shall show, as data."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from labapp.files.phase_table import (
    AnnularPattern,
    AxiconPattern,
    BinaryPattern,
    BlazePattern,
    CubicPattern,
    LensPattern,
    PatchesPattern,
    PhasePattern,
    SinePattern,
    ZernikePattern,
)
from labapp.files.phase_table import Positive as Positive
from labapp.files.reading import FileModel
from labapp.files.target_table import RingTarget, TargetTable

Grey = Annotated[int, Field(ge=0, le=255)]
Iterations = Annotated[int, Field(ge=1, le=10_000)]

Method = Literal[
    "published",
    "gerchberg-saxton",
    "mixed-region",
    "over-compensated",
    "weighted",
    "independent",
    "sequential",
    "joint",
    "responding",
    "descent",
]
"""Of phase retrieval, as optics.retrieval has them."""


class GreyPattern(FileModel):
    """A pattern of grey levels, whatever phase they make."""

    @property
    def varies(self) -> bool:
        """Whether another seed makes another pattern."""
        return False

    @property
    def label(self) -> str:
        """What it is called on the screen and in records."""
        raise NotImplementedError

    def quick(self) -> GreyPattern:
        """The same with as little work as shows whether it can be computed."""
        return self


class ConstantPattern(GreyPattern):
    """One grey level everywhere; a neutral pattern."""

    kind: Literal["constant"]
    grey: Annotated[Grey, Field(description="level")] = 0

    @property
    def label(self) -> str:
        return "neutral" if self.grey == 0 else f"grey {self.grey}"


class GratingPattern(GreyPattern):
    """Stripes of two grey levels, equally wide; the light in the centre tells their phase step."""

    kind: Literal["grating"]
    period_px: Annotated[
        int, Field(ge=2, le=4096, multiple_of=2, description="of both stripes")
    ] = 16
    low: Annotated[Grey, Field(description="level")] = 0
    high: Annotated[Grey, Field(description="level")]
    axis: Annotated[Literal["x", "y"], Field(description="along which levels change")] = "x"

    @property
    def label(self) -> str:
        return f"grating {self.period_px} px, grey {self.low} and {self.high}"


class ImagePattern(GreyPattern):
    """Grey levels from an 8-bit picture of the panel's size, or from a design file (.h5)."""

    kind: Literal["image"]
    file: Annotated[str, Field(description="picture, or .h5 of labapp pattern or retrieve")]
    frame: Annotated[int, Field(ge=0, description="of a design file, from 0")] = 0

    @property
    def label(self) -> str:
        which = f" frame {self.frame}" if self.frame else ""
        return f"image {self.file.rpartition('/')[2]}{which}"


class RingPattern(PhasePattern):
    """A pattern whose PSF is a ring, by Gerchberg-Saxton. Sizes on the sensor."""

    smooth: ClassVar[bool] = False
    kind: Literal["ring"]
    radius_um: Annotated[Positive, Field(description="of the ring on the sensor")]
    width_um: Annotated[Positive, Field(description="standard deviation of its profile")]
    iterations: Annotated[Iterations, Field(description="of Gerchberg-Saxton")] = 30
    start: Annotated[
        Literal["quadratic", "random"], Field(description="phase that iterations start from")
    ] = "quadratic"

    @property
    def varies(self) -> bool:
        return self.start == "random"

    @property
    def sizes(self) -> str:
        return f"ring {self.radius_um:g}/{self.width_um:g} µm"

    @property
    def target(self) -> RingTarget:
        return RingTarget(shape="ring", radius_um=self.radius_um, width_um=self.width_um)

    def quick(self) -> RingPattern:
        return self.model_copy(update={"iterations": 1})


class PSFPattern(PhasePattern):
    """A pattern whose PSF has a target's shape, by phase retrieval.

    Frames of a video know of each other: it is their mean that has the shape.
    """

    smooth: ClassVar[bool] = False
    kind: Literal["psf"]
    target: Annotated[TargetTable, Field(description="a shape: see labapp retrieve list")]
    budget_s: Annotated[
        Positive | None, Field(description="processor seconds to spend; or iterations")
    ] = None
    iterations: Annotated[Iterations | None, Field(description="of the method")] = None
    method: Annotated[Method | None, Field(description="none: what serves best")] = None

    @model_validator(mode="after")
    def _one_price(self) -> PSFPattern:
        if self.budget_s is not None and self.iterations is not None:
            raise ValueError("a psf has either budget_s or iterations")
        return self

    @property
    def varies(self) -> bool:
        return True

    @property
    def sizes(self) -> str:
        return self.target.sizes

    def quick(self) -> PSFPattern:
        changes = {"iterations": 1, "budget_s": None, "target": self.target.quick()}
        return self.model_copy(update=changes)


class SumPattern(PhasePattern):
    """Several patterns at once: their phases add up."""

    kind: Literal["sum"]
    parts: Annotated[
        tuple[PhaseTable, ...], Field(min_length=1, description="tables of patterns with phases")
    ]

    @model_validator(mode="before")
    @classmethod
    def _parts_are_for_the_same(cls, table: Any) -> Any:
        """A part that doesn't say its wavelength is for the sum's."""
        if not (isinstance(table, dict) and "wavelength_nm" in table and "parts" in table):
            return table
        shared = {"wavelength_nm": table["wavelength_nm"]}
        given = table["parts"] if isinstance(table["parts"], list | tuple) else ()
        parts = [shared | part if isinstance(part, dict) else part for part in given]
        return table | {"parts": parts or table["parts"]}

    @model_validator(mode="after")
    def _one_wavelength(self) -> SumPattern:
        for part in self.parts:
            if part.wavelength_nm != self.wavelength_nm:
                raise ValueError(
                    f"a part is for {part.wavelength_nm:g} nm and the sum for "
                    f"{self.wavelength_nm:g} nm; give all of them the same wavelength_nm"
                )
        return self

    @property
    def varies(self) -> bool:
        return any(part.varies for part in self.parts)

    @property
    def sizes(self) -> str:
        return " + ".join(part.sizes for part in self.parts)

    def quick(self) -> SumPattern:
        return self.model_copy(update={"parts": tuple(part.quick() for part in self.parts)})


Greys = ConstantPattern | GratingPattern | ImagePattern

Phases = (
    LensPattern
    | AxiconPattern
    | CubicPattern
    | AnnularPattern
    | BlazePattern
    | BinaryPattern
    | SinePattern
    | PatchesPattern
    | ZernikePattern
    | RingPattern
    | PSFPattern
    | SumPattern
)

PhaseTable = Annotated[Phases, Field(discriminator="kind")]
"""What has a phase of its own, so that it can be added to others."""

Still = Annotated[Greys | Phases, Field(discriminator="kind")]

SumPattern.model_rebuild()


class VideoPattern(FileModel):
    """Frames that the SLM shows one after the other, again and again (thesis section 3.5).

    frames: names of the plan's still patterns; or pattern: one still pattern, computed
    `count` times, frame k from the plan's seed + k, so that its random starts differ. Frames
    of a psf are retrieved together, and a shape that changes with time has its moments in turn.
    """

    kind: Literal["video"]
    frames: tuple[str, ...] = ()
    pattern: Still | None = None
    count: Annotated[int, Field(ge=2, le=3600)] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> VideoPattern:
        by_name, by_count = bool(self.frames), self.pattern is not None and self.count is not None
        if by_name == by_count or (by_name and (self.pattern or self.count)):
            raise ValueError("a video has either frames, or a pattern with a count")
        if len(self.frames) == 1:
            raise ValueError("a video has two frames at least; show the still pattern itself")
        if self.pattern is not None and not self.pattern.varies:
            raise ValueError("its frames would all be alike; give a ring with start = 'random'")
        if isinstance(self.pattern, PSFPattern) and self.count is not None:
            self.pattern.target.require_frames(self.count)
        return self

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(self.frames) or self.count or 0

    @property
    def label(self) -> str:
        """What it is called on the screen and in records."""
        return f"video of {self.length}" + (f" x {self.pattern.label}" if self.pattern else "")

    def quick(self) -> VideoPattern:
        """The same with as little work as shows whether it can be computed."""
        if self.pattern is None:
            return self
        return self.model_copy(update={"pattern": self.pattern.quick(), "count": 2})


Pattern = Annotated[Greys | Phases | VideoPattern, Field(discriminator="kind")]
