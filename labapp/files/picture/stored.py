"""What the reader of a picture's format gives back: the numbers, and all that the file says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from labapp.files.exif import Exif
from labapp.files.picture.encoding import Encoding

ALPHA_LEFT_OUT = "its alpha was left out: colours are as they're stored"
"""What is said of a picture with transparency."""


@dataclass(frozen=True, eq=False)
class StoredPicture:
    """A picture as its file has it; the sensor's order is kept.

    values: (bands, rows, columns), numbers as stored; 1 band, or red, green and blue.
    kind: the format in words, as in "OpenEXR, half".
    white: number of white for coded integers, None where the file has none.
    encoding: None where the file doesn't say; `encoding_source` is who says it.
    pages: pictures in the file.
    orientation: 1 to 8, as Exif counts them; 1 is upright.
    is_lossy: whether the compression changed the numbers.
    notes: what was done or left out, in words.
    encoding_refusal: why what the file says of its encoding can't be turned into light; empty if it
    can.
    """

    values: NDArray[Any]
    kind: str
    white: float | None = None
    encoding: Encoding | None = None
    encoding_source: str = ""
    pages: int = 1
    orientation: int = 1
    exif: Exif | None = None
    is_lossy: bool = False
    notes: tuple[str, ...] = ()
    encoding_refusal: str = ""
