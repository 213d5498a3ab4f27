"""The patterns of a plan file: what the SLM shall show, as data."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.reading import FileModel

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class ConstantPattern(FileModel):
    """One grey level everywhere; a neutral pattern."""

    kind: Literal["constant"]
    grey: Annotated[int, Field(ge=0, le=255)] = 0


Grey = Annotated[int, Field(ge=0, le=255)]


class GratingPattern(FileModel):
    """Stripes of two grey levels, equally wide; the light in the centre tells their phase step.

    period_px: of both stripes, in panel pixels. axis: along which the grey levels change.
    """

    kind: Literal["grating"]
    period_px: Annotated[int, Field(ge=2, le=4096, multiple_of=2)] = 16
    low: Grey = 0
    high: Grey
    axis: Literal["x", "y"] = "x"


class RingPattern(FileModel):
    """A pattern whose PSF is a ring, by Gerchberg-Saxton. Sizes on the sensor."""

    kind: Literal["ring"]
    radius_um: Positive
    width_um: Positive
    wavelength_nm: Positive = 550
    iterations: Annotated[int, Field(ge=1, le=10_000)] = 30
    start: Literal["quadratic", "random"] = "quadratic"


class LensPattern(FileModel):
    """A Fresnel lens of a focal length; negative diverges."""

    kind: Literal["lens"]
    focal_length_m: Annotated[float, Field(allow_inf_nan=False)]
    wavelength_nm: Positive = 550


class AxiconPattern(FileModel):
    """A cone that sends a point to a ring of a radius on the sensor."""

    kind: Literal["axicon"]
    radius_um: Positive
    wavelength_nm: Positive = 550


class ImagePattern(FileModel):
    """Grey levels from an 8-bit picture of the panel's size."""

    kind: Literal["image"]
    file: str


Still = Annotated[
    ConstantPattern | GratingPattern | RingPattern | LensPattern | AxiconPattern | ImagePattern,
    Field(discriminator="kind"),
]


class VideoPattern(FileModel):
    """Frames that the SLM shows one after the other, again and again (thesis section 3.5).

    frames: names of the plan's still patterns; or pattern: one still pattern, computed
    `count` times, frame k from the plan's seed + k, so that its random starts differ.
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
        if self.pattern is not None and getattr(self.pattern, "start", "") != "random":
            raise ValueError("its frames would all be alike; give a ring with start = 'random'")
        return self

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(self.frames) or self.count or 0


Pattern = Annotated[
    ConstantPattern
    | GratingPattern
    | RingPattern
    | LensPattern
    | AxiconPattern
    | ImagePattern
    | VideoPattern,
    Field(discriminator="kind"),
]
