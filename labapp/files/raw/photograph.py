"""What a camera's sensor gave: the numbers of its pixels, and what the file says of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.files.exif import Exif

Light = NDArray[np.float32]


@dataclass(frozen=True)
class CameraColour:
    """The camera's colours; None where its file doesn't say.

    Attributes
    ----------
    matrix : NDArray or None, (channels, 3)
        From CIE XYZ to the camera's channels, in the order of `RawPhotograph.channels`.
    illuminant : str
        Light that the matrix is for, in words.
    white : NDArray or None, (channels,)
        What white gives in each channel, on any scale, as the camera found it.
    noise : NDArray or None, (channels, 2)
        Variance of a pixel as S x + O of its light x, white at 1: S and O of each channel.
    """

    matrix: NDArray[np.float64] | None = None
    illuminant: str = ""
    white: NDArray[np.float64] | None = None
    noise: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class RawPhotograph:
    """A RAW photograph: a number for each pixel of the sensor, in the sensor's order.

    Attributes
    ----------
    path, kind : Path, str
        The file, and what it is, in words, as "DNG, 126 x 146, RG/GB".
    mosaic : NDArray of uint16, (rows, columns)
        The sensor's numbers in the area that sees the scene, never turned, made linear by the
        file's table.
    pattern : tuple of str or None
        Rows of a letter for each pixel, which repeat from the first pixel of `mosaic` on, as
        ("RG", "GB"). None without colour filters.
    black : NDArray, (cell rows, cell columns)
        Level of darkness of the pixels of a cell, which repeats likewise.
    white : float
        Level of a full well, or of the highest number.
    black_rows, black_columns : NDArray or None
        What each row's and each column's level of darkness has beyond `black`.
    linear_limit : float or None
        Level up to which numbers are proportional to light, where the maker says that it is below
        `white`.
    colour, exposure : CameraColour, Exif
        The camera's colours; exposure time, aperture and sensitivity.
    orientation : int
        How to turn the picture for people to see, 1 to 8 as in EXIF. It isn't applied.
    maker, model : str
        The camera; empty where the file doesn't say.
    notes : tuple of str
        What was done or left out, for the user.
    """

    path: Path
    kind: str
    mosaic: NDArray[np.uint16]
    pattern: tuple[str, ...] | None
    black: NDArray[np.float64]
    white: float
    black_rows: NDArray[np.float64] | None = None
    black_columns: NDArray[np.float64] | None = None
    linear_limit: float | None = None
    colour: CameraColour = field(default_factory=CameraColour)
    exposure: Exif = field(default_factory=Exif)
    orientation: int = 1
    maker: str = ""
    model: str = ""
    notes: tuple[str, ...] = ()

    @property
    def channels(self) -> str:
        """Letters of the colour filters, each once: red, green and blue first."""
        return order_channels(self.pattern or ())

    @cached_property
    def dark_levels(self) -> Light:
        """Level of darkness of each pixel of the mosaic, (rows, columns)."""
        rows, columns = self.mosaic.shape
        down, along = (-(-n // m) for n, m in zip(self.mosaic.shape, self.black.shape, strict=True))
        levels = np.tile(self.black, (down, along))[:rows, :columns]
        if self.black_rows is not None:
            levels = levels + self.black_rows[:, None]
        if self.black_columns is not None:
            levels = levels + self.black_columns
        return levels.astype(np.float32)

    def light(self, dark: float | None = None) -> Light:
        """Return the light of each pixel, (rows, columns), of which 1 fills its well.

        `dark` takes the place of the file's level of darkness. Noise makes dark pixels negative.
        """
        black = self.dark_levels if dark is None else np.float32(dark)
        light: Light = (self.mosaic - black) / (np.float32(self.white) - black)
        return light

    @cached_property
    def clip_level(self) -> float:
        """Level from which pixels count as clipped: stated, or where the mosaic shows it."""
        down, along = (1, 1) if not self.pattern else (len(self.pattern), len(self.pattern[0]))
        # The pixels of each place in the pattern's cell.
        planes = [self.mosaic[y::down, x::along] for y in range(down) for x in range(along)]
        stated = [self.white, self.linear_limit, saturated_level(planes)]
        return min(level for level in stated if level is not None)


def order_channels(pattern: tuple[str, ...]) -> str:
    """Return the letters of a mosaic's pattern, each once: red, green and blue first."""
    found = set("".join(pattern))
    return "".join(sorted(found, key=lambda letter: ("RGBCMYW".find(letter) % 99, letter)))


def saturated_level(planes: Sequence[NDArray[Any]]) -> float | None:
    """Find the level at which wells were full; None if planes of one colour show no sign of it.

    The sign is 3 neighbouring pixels of one colour at the highest level of all, if there are at
    least twice as many pixels at it as at the level below, where levels are whole numbers.
    """
    top = max(plane.max() for plane in planes if plane.size)
    at = [plane == top for plane in planes]
    if all(one.all() for one in at) or not any(_has_run(one) or _has_run(one.T) for one in at):
        return None
    if all(one.dtype.kind != "f" or np.array_equal(one, np.rint(one)) for one in planes):
        below = sum(int((plane == top - 1).sum()) for plane in planes)
        if sum(int(one.sum()) for one in at) < 2 * below:
            return None
    return float(top)


def _has_run(at: NDArray[np.bool_]) -> bool:
    """Return whether 3 neighbouring pixels of a row are set."""
    return bool((at[:, :-2] & at[:, 1:-1] & at[:, 2:]).any())
