"""The patterns of a plan, and the union of all their kinds."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from annotated_types import MinLen
from pydantic import Field, TypeAdapter, model_validator

from labapp.files.formula_patterns import FORMULA_PATTERNS
from labapp.files.grey_table import GREY_PATTERNS, GreyPattern
from labapp.files.phase_table import Iterations, PhasePattern, RingPattern
from labapp.files.reading import FileModel
from labapp.files.table import Key, Positive, tag_value
from labapp.files.target_table import TARGET_SHAPES, TargetShape

RetrievalMethod = Literal[
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
"""Names of the methods of phase retrieval in optics.retrieval."""


def _tagged_union(tables: Iterable[Any], tag: str) -> Any:
    """Return the union type of several tables, which pydantic tells apart by a key `tag`."""
    return Annotated[reduce(operator.or_, tables), Field(discriminator=tag)]


if TYPE_CHECKING:
    TargetTable = TargetShape
else:
    TargetTable = _tagged_union(TARGET_SHAPES, "shape")


class PSFPattern(PhasePattern):
    """A pattern whose PSF has a target's shape, by phase retrieval.

    The frames of a video are retrieved together, so that the mean of their PSFs has the shape.
    """

    smooth: ClassVar[bool] = False
    kind: Literal["psf"]
    target: Annotated[TargetTable, Key("a shape: see labapp retrieve list")]
    budget_s: Annotated[Positive | None, Key("processor seconds to spend; or iterations")] = None
    iterations: Annotated[Iterations | None, Key("of the method")] = None
    method: Annotated[RetrievalMethod | None, Key("none: what serves best")] = None

    def __post_init__(self) -> None:
        if self.budget_s is not None and self.iterations is not None:
            raise ValueError("a psf has either budget_s or iterations")

    @property
    def depends_on_seed(self) -> bool:
        return True

    @property
    def summary(self) -> str:
        return self.target.summary

    def with_least_work(self) -> PSFPattern:
        return replace(self, iterations=1, budget_s=None, target=self.target.with_least_work())


class SumPattern(PhasePattern):
    """Several patterns at once: their phases add up."""

    kind: Literal["sum"]
    parts: Annotated[tuple[PhaseTable, ...], MinLen(1), Key("tables of patterns with phases")]

    @model_validator(mode="before")
    @classmethod
    def _inherit_wavelength(cls, table: Any) -> Any:
        """Give the sum's wavelength to those of its parts that have none."""
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
    def depends_on_seed(self) -> bool:
        return any(part.depends_on_seed for part in self.parts)

    @property
    def summary(self) -> str:
        return " + ".join(part.summary for part in self.parts)

    def with_least_work(self) -> SumPattern:
        return replace(self, parts=tuple(part.with_least_work() for part in self.parts))


PHASE_PATTERNS: tuple[type[PhasePattern], ...] = (
    *FORMULA_PATTERNS,
    RingPattern,
    PSFPattern,
    SumPattern,
)

if TYPE_CHECKING:
    PhaseTable = PhasePattern
    StillPattern = GreyPattern | PhasePattern
else:
    PhaseTable = _tagged_union(PHASE_PATTERNS, "kind")
    StillPattern = _tagged_union((*GREY_PATTERNS, *PHASE_PATTERNS), "kind")

_stills: tuple[type[GreyPattern | PhasePattern], ...] = (*GREY_PATTERNS, *PHASE_PATTERNS)
STILL_PATTERNS = {tag_value(one, "kind"): one for one in _stills}
"""All kinds of still patterns by their names, for listing, reading and showing them."""


class VideoPattern(FileModel):
    """Frames that the SLM shows one after the other, again and again (thesis section 3.5).

    A video has either `frames`, names of the plan's still patterns, or one still `pattern`, which
    is computed `count` times. Frame k is then computed with the plan's seed + k, so that the
    random starts differ. The frames of a pattern of kind `psf` are retrieved together. If its
    target changes with time, equal groups of frames show the moments in turn.
    """

    kind: Literal["video"]
    frames: tuple[str, ...] = ()
    pattern: StillPattern | None = None
    count: Annotated[int, Field(ge=2, le=3600)] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> VideoPattern:
        by_name, by_count = bool(self.frames), self.pattern is not None and self.count is not None
        if by_name == by_count or (by_name and (self.pattern or self.count)):
            raise ValueError("a video has either frames, or a pattern with a count")
        if len(self.frames) == 1:
            raise ValueError("a video has two frames at least; show the still pattern itself")
        if self.pattern is not None and not self.pattern.depends_on_seed:
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
        """The description on the screen and in records."""
        return f"video of {self.length}" + (f" x {self.pattern.label}" if self.pattern else "")

    def with_least_work(self) -> VideoPattern:
        """Reduce the work to what shows whether the video can be computed."""
        if self.pattern is None:
            return self
        return self.model_copy(update={"pattern": self.pattern.with_least_work(), "count": 2})


if TYPE_CHECKING:
    Pattern = StillPattern | VideoPattern
else:
    Pattern = _tagged_union((*GREY_PATTERNS, *PHASE_PATTERNS, VideoPattern), "kind")


def pattern_data(spec: StillPattern | VideoPattern) -> dict[str, Any]:
    """Return a pattern's table as plain data."""
    return TypeAdapter(type(spec)).dump_python(spec, mode="json")
