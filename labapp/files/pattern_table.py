"""The patterns of a plan file: what the SLM shall show, as data."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from annotated_types import MinLen
from pydantic import Field, TypeAdapter, model_validator

from labapp.files.grey_table import GREYS, GreyPattern
from labapp.files.phase_table import FORMULAS, Iterations, PhasePattern, RingPattern
from labapp.files.reading import FileModel
from labapp.files.table import Key, Positive, tag_of
from labapp.files.target_table import SHAPES, TargetShape

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


def _any_of(tables: Iterable[Any], tag: str) -> Any:
    """The type of whatever is one of the tables, which its tag tells."""
    return Annotated[reduce(operator.or_, tables), Field(discriminator=tag)]


if TYPE_CHECKING:
    TargetTable = TargetShape
else:
    TargetTable = _any_of(SHAPES, "shape")


class PSFPattern(PhasePattern):
    """A pattern whose PSF has a target's shape, by phase retrieval.

    Frames of a video know of each other: it is their mean that has the shape.
    """

    smooth: ClassVar[bool] = False
    kind: Literal["psf"]
    target: Annotated[TargetTable, Key("a shape: see labapp retrieve list")]
    budget_s: Annotated[Positive | None, Key("processor seconds to spend; or iterations")] = None
    iterations: Annotated[Iterations | None, Key("of the method")] = None
    method: Annotated[Method | None, Key("none: what serves best")] = None

    def __post_init__(self) -> None:
        if self.budget_s is not None and self.iterations is not None:
            raise ValueError("a psf has either budget_s or iterations")

    @property
    def varies(self) -> bool:
        return True

    @property
    def sizes(self) -> str:
        return self.target.sizes

    def quick(self) -> PSFPattern:
        return replace(self, iterations=1, budget_s=None, target=self.target.quick())


class SumPattern(PhasePattern):
    """Several patterns at once: their phases add up."""

    kind: Literal["sum"]
    parts: Annotated[tuple[PhaseTable, ...], MinLen(1), Key("tables of patterns with phases")]

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

    def __post_init__(self) -> None:
        for part in self.parts:
            if part.wavelength_nm != self.wavelength_nm:
                raise ValueError(
                    f"a part is for {part.wavelength_nm:g} nm and the sum for "
                    f"{self.wavelength_nm:g} nm; give all of them the same wavelength_nm"
                )

    @property
    def varies(self) -> bool:
        return any(part.varies for part in self.parts)

    @property
    def sizes(self) -> str:
        return " + ".join(part.sizes for part in self.parts)

    def quick(self) -> SumPattern:
        return replace(self, parts=tuple(part.quick() for part in self.parts))


PHASES: tuple[type[PhasePattern], ...] = (*FORMULAS, RingPattern, PSFPattern, SumPattern)

if TYPE_CHECKING:
    PhaseTable = PhasePattern
    Still = GreyPattern | PhasePattern
else:
    PhaseTable = _any_of(PHASES, "kind")
    Still = _any_of((*GREYS, *PHASES), "kind")

_stills: tuple[type[GreyPattern | PhasePattern], ...] = (*GREYS, *PHASES)
STILLS = {tag_of(one, "kind"): one for one in _stills}
"""All kinds by their names: whoever lists, reads or shows patterns takes them from here."""


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


if TYPE_CHECKING:
    Pattern = Still | VideoPattern
else:
    Pattern = _any_of((*GREYS, *PHASES, VideoPattern), "kind")


def pattern_data(spec: Still | VideoPattern) -> dict[str, Any]:
    """A pattern as a plan file writes it, as plain data."""
    return TypeAdapter(type(spec)).dump_python(spec, mode="json")
