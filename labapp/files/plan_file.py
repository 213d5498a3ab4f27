"""The plan file: what is to be acquired, as data."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.reading import FileModel

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Names = Annotated[tuple[str, ...], Field(min_length=1)]


class ConstantPattern(FileModel):
    """One grey level everywhere; a neutral pattern."""

    kind: Literal["constant"]
    grey: Annotated[int, Field(ge=0, le=255)] = 0


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
    focal_length_m: float
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


Pattern = Annotated[
    ConstantPattern | RingPattern | LensPattern | AxiconPattern | ImagePattern,
    Field(discriminator="kind"),
]


class Acquisition(FileModel):
    """One block: targets x patterns x wavelengths x exposures, each `repeats` times."""

    targets: Names
    patterns: Names
    wavelengths_nm: Annotated[tuple[Positive, ...], Field(min_length=1)]
    exposures_ms: Annotated[tuple[Positive, ...], Field(min_length=1)]
    repeats: Annotated[int, Field(ge=1, le=10_000)] = 1


class Reconstruction(FileModel):
    """Which targets and patterns play which part when the pictures are undone.

    wavelength_nm is needed only if the plan has several.
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
    """An acquisition plan; the same plan runs from window, command line and Python."""

    version: Literal[1]
    title: str
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    patterns: Annotated[dict[str, Pattern], Field(min_length=1)]
    acquire: Annotated[tuple[Acquisition, ...], Field(min_length=1)]
    reconstruct: Reconstruction | None = None

    @model_validator(mode="after")
    def _names_exist(self) -> PlanFile:
        for block in self.acquire:
            for name in block.patterns:
                if name not in self.patterns:
                    raise ValueError(
                        f"acquire asks for pattern {name!r}, and the patterns are "
                        + ", ".join(self.patterns)
                    )
        return self
