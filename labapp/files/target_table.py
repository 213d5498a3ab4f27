"""The PSF shapes of a plan file: keys and units, and what they draw.

What draws is imported when a drawing is asked for, so that plans are read and shapes are listed
without it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from labapp.files.reading import FileModel, read_grey

if TYPE_CHECKING:
    from optics.targets.drawing import Drawing

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=10_000)]

Radius = Annotated[Positive, Field(description="from the axis, on the sensor")]
Width = Annotated[Positive, Field(description="of a stroke: a Gaussian's standard deviation")]


class TargetShape(FileModel):
    """A PSF shape."""

    @property
    def sizes(self) -> str:
        """What it is and how large, in a few words."""
        raise NotImplementedError

    def require_frames(self, frames: int) -> None:
        """ValueError if a video of so many frames can't show it."""

    def quick(self) -> TargetShape:
        """The same, at as few moments as show whether it can be drawn."""
        return self

    def at(self, frames: int, folder: Path) -> list[Drawing]:
        """Its pictures during a video, as many as divide the frames; of most shapes, one.

        folder: where picture files lie. ValueError for sizes that can't be.
        """
        return [self.draw(folder)]

    def draw(self, folder: Path) -> Drawing:
        """A shape that stands still."""
        raise NotImplementedError


class Stroked(TargetShape):
    """What is drawn within a circle, with a stroke."""

    radius_um: Radius = 100.0
    width_um: Width = 8.0

    @property
    def sizes(self) -> str:
        return f"{vars(self)['shape']} {self.radius_um:g}/{self.width_um:g} µm"

    @property
    def _metres(self) -> tuple[float, float]:
        return self.radius_um * 1e-6, self.width_um * 1e-6


class RingTarget(Stroked):
    """A ring."""

    shape: Literal["ring"]

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        return targets.ring.draw(*self._metres)


class Spiral(Stroked):
    """What every spiral has."""

    turns: Annotated[float, Field(gt=0, le=50, description="from the axis outwards")] = 3.0
    hole: Annotated[float, Field(ge=0, lt=1, description="share of the radius left out")] = 0.36


class SpiralTarget(Spiral):
    """The thesis' spiral (Fig. 3.3): its distance from the axis grows as the angle squared."""

    shape: Literal["spiral"]

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        return targets.spiral.draw(*self._metres, self.turns, self.hole)


class ShrinkingSpiralTarget(Spiral):
    """A spiral that shrinks with time (thesis Fig. 3.4); for videos."""

    shape: Literal["shrinking-spiral"]
    smallest: Annotated[
        float, Field(gt=0, le=1, description="share of the radius at the last moment")
    ] = 0.4
    moments: Annotated[
        int | None, Field(ge=2, le=3600, description="that frames share evenly; none: one each")
    ] = None

    def quick(self) -> ShrinkingSpiralTarget:
        return self.model_copy(update={"moments": None})

    def require_frames(self, frames: int) -> None:
        if frames < 2:
            raise ValueError(
                "a shrinking spiral changes with time; make a video of 2 frames or more"
            )
        if self.moments is not None and frames % self.moments:
            raise ValueError(f"{self.moments} moments don't share {frames} frames evenly")

    def at(self, frames: int, folder: Path) -> list[Drawing]:
        from optics import targets

        self.require_frames(frames)
        moments = self.moments or frames
        sizes = (*self._metres, moments, self.smallest, self.turns, self.hole)
        return list(targets.shrinking_spiral.draw(*sizes).parts)


class HeartTarget(Stroked):
    """A heart, upright."""

    shape: Literal["heart"]

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        return targets.heart.draw(*self._metres)


class InfinityTarget(Stroked):
    """The symbol of infinity, lying."""

    shape: Literal["infinity"]

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        return targets.infinity.draw(*self._metres)


class EyeTarget(Stroked):
    """An eye with its iris and pupil."""

    shape: Literal["eye"]

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        return targets.eye.draw(*self._metres)


class DotsTarget(TargetShape):
    """Dots on a circle; in a grid, with rows and columns; or at positions."""

    shape: Literal["dots"]
    count: Annotated[Count, Field(description="on a circle")] = 8
    radius_um: Annotated[Positive, Field(description="of the circle")] = 100.0
    rows: Annotated[Count | None, Field(description="of a grid")] = None
    columns: Annotated[Count | None, Field(description="of a grid")] = None
    spacing_um: Annotated[Positive, Field(description="in the grid")] = 40.0
    positions_um: Annotated[
        tuple[tuple[Finite, Finite], ...], Field(description="y and x of each, instead")
    ] = ()
    width_um: Annotated[Positive, Field(description="standard deviation of a dot")] = 8.0

    @model_validator(mode="after")
    def _one_way(self) -> DotsTarget:
        if (self.rows is None) != (self.columns is None):
            raise ValueError("a grid of dots has rows and columns; give both")
        if self.rows is not None and self.positions_um:
            raise ValueError("dots have either rows and columns, or positions_um")
        return self

    @property
    def sizes(self) -> str:
        if self.positions_um:
            return f"dots {len(self.positions_um)}"
        if self.rows is not None:
            return f"dots {self.columns}x{self.rows}, {self.spacing_um:g} µm"
        return f"dots {self.count}, {self.radius_um:g} µm"

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        if self.positions_um:
            places = [(y * 1e-6, x * 1e-6) for y, x in self.positions_um]
        elif self.rows is not None and self.columns is not None:
            places = targets.on_grid((self.rows, self.columns), self.spacing_um * 1e-6)
        else:
            places = targets.on_ring(self.count, self.radius_um * 1e-6)
        return targets.dots.draw(places, self.width_um * 1e-6)


class LettersTarget(TargetShape):
    """A line of text."""

    shape: Literal["letters"]
    text: Annotated[str, Field(min_length=1, max_length=80, description="letters and digits")]
    height_um: Annotated[Positive, Field(description="of a capital")] = 100.0
    width_um: Width = 8.0

    @property
    def sizes(self) -> str:
        return f"letters {self.text} {self.height_um:g}/{self.width_um:g} µm"

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        return targets.letters.draw(self.text, self.height_um * 1e-6, self.width_um * 1e-6)


class LogoTarget(TargetShape):
    """A grey picture: bright is light."""

    shape: Literal["logo"]
    file: Annotated[str, Field(min_length=1, description="8-bit picture")]
    size_um: Annotated[Positive, Field(description="of its longer side")] = 200.0
    invert: Annotated[bool, Field(description="dark is light")] = False

    @property
    def sizes(self) -> str:
        return f"logo {Path(self.file).name} {self.size_um:g} µm"

    def draw(self, folder: Path) -> Drawing:
        import torch

        from optics import targets

        picture = torch.from_numpy(read_grey(folder / self.file))
        return targets.logo.draw(picture, self.size_um * 1e-6, self.invert)


class DispersionTarget(TargetShape):
    """A row of dots, as a prism makes it of so many wavelengths (thesis Fig. 4.11)."""

    shape: Literal["dispersion"]
    wavelengths_nm: Annotated[
        tuple[Positive, ...], Field(min_length=1, max_length=1000, description="one dot each")
    ]
    reference_nm: Annotated[Positive, Field(description="which stays on the axis")] = 550.0
    um_per_nm: Annotated[Finite, Field(description="shift with the wavelength")] = 1.0
    angle_deg: Annotated[Finite, Field(description="of longer waves, from x towards y")] = 0.0
    width_um: Annotated[Positive, Field(description="standard deviation of a dot")] = 8.0

    @property
    def sizes(self) -> str:
        return f"dispersion {len(self.wavelengths_nm)} x {self.um_per_nm:g} µm/nm"

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        places = targets.dispersed(
            [nm * 1e-9 for nm in self.wavelengths_nm],
            self.reference_nm * 1e-9,
            self.um_per_nm * 1e3,
            math.radians(self.angle_deg),
        )
        return targets.dots.draw(places, self.width_um * 1e-6)


Shapes = (
    RingTarget
    | SpiralTarget
    | ShrinkingSpiralTarget
    | HeartTarget
    | InfinityTarget
    | EyeTarget
    | DotsTarget
    | LettersTarget
    | LogoTarget
    | DispersionTarget
)

TargetTable = Annotated[Shapes, Field(discriminator="shape")]
