"""Exposure brackets that a plan wants for a signal-to-noise ratio, and what was chosen for them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.quantities import Amount, Nanometres, Positive
from labapp.files.reading import FileModel

Rates = tuple[Positive, Positive]
"""Electrons per second, the lower rate first."""


class BracketTable(FileModel):
    """What a block of a plan wants of an exposure bracket whose exposures are chosen.

    snr_db is the signal-to-noise ratio of each merged pixel, 20 log10. The range is `decades` below
    the brightest pixels, or electrons_per_s, so that nothing is metered; by default it is that of
    the scene. least is what is minimised, of at most most_frames; shortest_ms and longest_ms narrow
    the exposures that the camera can take.
    """

    snr_db: Annotated[float, Field(ge=0, le=80)]
    decades: Annotated[float, Field(gt=0, le=12)] | None = None
    electrons_per_s: Rates | None = None
    least: Literal["time", "frames"] = "time"
    most_frames: Annotated[int, Field(ge=1, le=200)] = 16
    shortest_ms: Positive | None = None
    longest_ms: Positive | None = None

    @model_validator(mode="after")
    def _has_one_range(self) -> BracketTable:
        if self.electrons_per_s is None:
            return self
        if self.decades is not None:
            raise ValueError("a bracket has either decades or electrons_per_s; remove one")
        low, high = self.electrons_per_s
        if low > high:
            raise ValueError("electrons_per_s has the lower rate first; exchange them")
        return self

    @property
    def is_metered(self) -> bool:
        """Whether the range of the light is left to metering."""
        return self.electrons_per_s is None

    def describe(self) -> str:
        """Say in words what is wanted: the ratio in dB, and the range."""
        if self.electrons_per_s is not None:
            low, high = self.electrons_per_s
            where = f"from {low:.3g} to {high:.3g} electrons/s"
        elif self.decades is not None:
            where = f"over {self.decades:g} decades below the brightest pixels"
        else:
            where = "over the range of the scene"
        return f"{self.snr_db:g} dB {where}"


class MeteredLight(FileModel):
    """What the metering of a target found, in a record's plan.

    noise_limited says that the darkest pixels can't be told from darkness. clip_level_dn is the
    number at which pixels were seen to clip, if the bench file doesn't tell it, and remark says so
    in words, or that it is unknown. blocks and quantiles are electrons per second in parts of the
    picture, and below which shares of the pixels lie: by them a later change of the scene is told.
    """

    target: str
    pattern: str
    wavelength_nm: Nanometres
    exposures_ms: tuple[Positive, ...]
    electrons_per_s: Rates
    noise_limited: bool = False
    clip_level_dn: Annotated[int, Field(ge=1, le=65535)] | None = None
    remark: str = ""
    blocks: tuple[tuple[float | None, ...], ...]
    quantiles: tuple[float | None, ...]


class Alternative(FileModel):
    """A bracket that wasn't chosen, in a record's plan; it reaches the same ratio."""

    name: str
    frames: int
    seconds: Amount


class ChosenTable(FileModel):
    """Why the exposures of a block were chosen, in a record's plan.

    wanted is the plan's own bracket. electrons_per_s is the range, darks the number of dark frames
    at each exposure. frames and seconds are those of one bracket with read-out, dark frames aside.
    """

    wanted: BracketTable
    electrons_per_s: Rates
    darks: int | None = None
    frames: int
    seconds: Amount
    least_snr_db: float
    alternatives: tuple[Alternative, ...] = ()
    metered: tuple[MeteredLight, ...] = ()
    metering_seconds: Amount = 0.0

    def describe(self) -> str:
        """Say in words what was chosen, and why."""
        low, high = self.electrons_per_s
        how = "metered" if self.metered else "given"
        return (
            f"{self.frames} exposures in {self.seconds:.3g} s for {self.wanted.describe()}: "
            f"{self.least_snr_db:.1f} dB or more from {low:.3g} to {high:.3g} electrons/s ({how})"
        )
