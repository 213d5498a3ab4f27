"""Target shapes of PSFs in a plan.

The modules that draw a shape are imported only when one is drawn, so that reading plans and
listing the shapes stay fast.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen

from labapp.files.table import Key, Nanometres, Positive, Table

if TYPE_CHECKING:
    from optics.targets.target import Drawing

Count = Annotated[int, Ge(1), Le(10_000)]

Radius = Annotated[Positive, Key("from the axis, on the sensor", "Radius", 80, 1, 2000)]
Width = Annotated[
    Positive, Key("of a stroke: a Gaussian's standard deviation", "Width", 8, 0.5, 500)
]


class TargetShape(Table):
    """A target of phase retrieval in a plan file: the requested shape of a PSF."""

    def require_frames(self, frames: int) -> None:
        """Raise ValueError if a video of `frames` frames can't show the target."""

    def with_least_work(self) -> TargetShape:
        """Reduce the target to as few moments as show whether it can be drawn."""
        return self

    def video_drawings(self, frames: int, folder: Path) -> list[Drawing]:
        """Return the drawings of the target at the moments of a video.

        Most targets have only one drawing. The number of moments divides `frames`. Pictures are
        read from `folder`. Raises ValueError for impossible sizes.
        """
        return [self.draw(folder)]

    def draw(self, folder: Path) -> Drawing:
        """Return the drawing of a target that doesn't change with time."""
        raise NotImplementedError


class StrokedTarget(TargetShape):
    """Base of the targets that are drawn with a stroke within a circle."""

    summary_template: ClassVar = "{shape} {radius_um:g}/{width_um:g} µm"
    radius_um: Radius = 100.0
    width_um: Width = 8.0

    @property
    def _metres(self) -> tuple[float, float]:
        return self.radius_um * 1e-6, self.width_um * 1e-6

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        drawn: Drawing = getattr(targets, vars(self)["shape"]).draw(*self._metres)
        return drawn


class RingTarget(StrokedTarget):
    """A ring as a PSF."""

    shape: Literal["ring"]


class SpiralTargetBase(StrokedTarget):
    """Base of the spiral targets."""

    turns: Annotated[float, Gt(0), Le(50), Key("from the axis outwards")] = 3.0
    hole: Annotated[float, Ge(0), Lt(1), Key("share of the radius left out")] = 0.36


class SpiralTarget(SpiralTargetBase):
    """The spiral of the thesis (Fig. 3.3), whose radius grows with the square of the angle."""

    title: ClassVar = "Spiral"
    shape: Literal["spiral"]

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        return targets.spiral.draw(*self._metres, self.turns, self.hole)


class ShrinkingSpiralTarget(SpiralTargetBase):
    """A spiral that shrinks with time (thesis Fig. 3.4), for videos."""

    shape: Literal["shrinking-spiral"]
    smallest: Annotated[float, Gt(0), Le(1), Key("share of the radius at the last moment")] = 0.4
    moments: Annotated[
        int | None, Ge(2), Le(3600), Key("that frames share evenly; none: one each")
    ] = None

    def with_least_work(self) -> ShrinkingSpiralTarget:
        return replace(self, moments=None)

    def require_frames(self, frames: int) -> None:
        if frames < 2:
            raise ValueError(
                "a shrinking spiral changes with time; make a video of 2 frames or more"
            )
        if self.moments is not None and frames % self.moments:
            raise ValueError(f"{self.moments} moments don't share {frames} frames evenly")

    def video_drawings(self, frames: int, folder: Path) -> list[Drawing]:
        from optics import targets

        self.require_frames(frames)
        moments = self.moments or frames
        sizes = (*self._metres, moments, self.smallest, self.turns, self.hole)
        return list(targets.shrinking_spiral.draw(*sizes).parts)


class HeartTarget(StrokedTarget):
    """An upright heart as a PSF."""

    title: ClassVar = "Heart"
    shape: Literal["heart"]


class InfinityTarget(StrokedTarget):
    """The infinity symbol."""

    title: ClassVar = "Infinity"
    shape: Literal["infinity"]


class EyeTarget(StrokedTarget):
    """An eye with iris and pupil as a PSF."""

    title: ClassVar = "Eye"
    shape: Literal["eye"]


class DotsTarget(TargetShape):
    """Dots on a circle; in a grid, with rows and columns; or at positions."""

    title: ClassVar = "Dots"
    shape: Literal["dots"]
    count: Annotated[Count, Key("on a circle", "Count", 8, 1, 200)] = 8
    radius_um: Annotated[Positive, Key("of the circle", "Radius", 80, 1, 2000)] = 100.0
    rows: Annotated[Count | None, Key("of a grid")] = None
    columns: Annotated[Count | None, Key("of a grid")] = None
    spacing_um: Annotated[Positive, Key("in the grid")] = 40.0
    positions_um: Annotated[tuple[tuple[float, float], ...], Key("y and x of each, instead")] = ()
    width_um: Annotated[Positive, Key("standard deviation of a dot", "Width", 8, 0.5, 500)] = 8.0

    def __post_init__(self) -> None:
        if (self.rows is None) != (self.columns is None):
            raise ValueError("a grid of dots has rows and columns; give both")
        if self.rows is not None and self.positions_um:
            raise ValueError("dots have either rows and columns, or positions_um")

    @property
    def summary(self) -> str:
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
            places = targets.grid_positions((self.rows, self.columns), self.spacing_um * 1e-6)
        else:
            places = targets.ring_positions(self.count, self.radius_um * 1e-6)
        return targets.dots.draw(places, self.width_um * 1e-6)


class LettersTarget(TargetShape):
    """A line of text as a PSF."""

    title: ClassVar = "Letters"
    summary_template: ClassVar = "letters {text} {height_um:g}/{width_um:g} µm"
    shape: Literal["letters"]
    text: Annotated[str, MinLen(1), MaxLen(80), Key("letters and digits", "Text", "EI", high=80)]
    height_um: Annotated[Positive, Key("of a capital", "Height", 100, 5, 2000)] = 100.0
    width_um: Annotated[
        Positive, Key("of a stroke: a Gaussian's standard deviation", "Width", 5, 0.5, 500)
    ] = 8.0

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        return targets.letters.draw(self.text, self.height_um * 1e-6, self.width_um * 1e-6)


class LogoTarget(TargetShape):
    """A grey picture, in which bright means light."""

    title: ClassVar = "Logo from a picture"
    shape: Literal["logo"]
    file: Annotated[str, MinLen(1), Key("8-bit picture", "8-bit picture, bright is light")]
    size_um: Annotated[Positive, Key("of its longer side", "Size", 160, 5, 4000)] = 200.0
    invert: Annotated[bool, Key("dark is light")] = False

    @property
    def summary(self) -> str:
        return f"logo {Path(self.file).name} {self.size_um:g} µm"

    def draw(self, folder: Path) -> Drawing:
        import torch

        from labapp.files.picture.colour_picture import read_drawing
        from optics import targets

        picture = torch.from_numpy(read_drawing(folder / self.file))
        return targets.logo.draw(picture, self.size_um * 1e-6, self.invert)


class DispersionTarget(TargetShape):
    """A row of dots, one for each wavelength, as a prism would make it (thesis Fig. 4.11)."""

    shape: Literal["dispersion"]
    wavelengths_nm: Annotated[tuple[Nanometres, ...], MinLen(1), MaxLen(1000), Key("one dot each")]
    reference_nm: Annotated[Nanometres, Key("which stays on the axis")] = 550.0
    um_per_nm: Annotated[float, Key("shift with the wavelength")] = 1.0
    angle_deg: Annotated[float, Key("of longer waves, from x towards y")] = 0.0
    width_um: Annotated[Positive, Key("standard deviation of a dot")] = 8.0

    @property
    def summary(self) -> str:
        return f"dispersion {len(self.wavelengths_nm)} x {self.um_per_nm:g} µm/nm"

    def draw(self, folder: Path) -> Drawing:
        from optics import targets

        places = targets.dispersed_positions(
            [nm * 1e-9 for nm in self.wavelengths_nm],
            self.reference_nm * 1e-9,
            self.um_per_nm * 1e3,
            math.radians(self.angle_deg),
        )
        return targets.dots.draw(places, self.width_um * 1e-6)


TARGET_SHAPES: tuple[type[TargetShape], ...] = (
    RingTarget,
    SpiralTarget,
    ShrinkingSpiralTarget,
    HeartTarget,
    InfinityTarget,
    EyeTarget,
    DotsTarget,
    LettersTarget,
    LogoTarget,
    DispersionTarget,
)
"""All target shapes, in the order in which they are listed."""
