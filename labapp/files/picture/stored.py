"""What readers of pictures give back: numbers, and what the file says; and words they share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
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
    encoding: None where the file doesn't say; `encoding_source` is who says it, and
    `encoding_refusal` why it can't be turned into light; empty if it can.
    pages: pictures in the file.
    orientation: 1 to 8, as Exif counts them; 1 is upright.
    is_lossy: whether the compression changed the numbers.
    notes: what was done or left out, in words.
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


_REMEDY = "Save it as PNG, or as TIFF of grey or of red, green and blue."


def refuse_picture(path: Path, what: str, remedy: str = _REMEDY) -> UserError:
    """Return the error that says what a picture file is, and what to do."""
    return UserError(f"{path}: is {what}. {remedy}")


INKS_TURNED = "its inks (CMYK) were turned into red, green and blue without their profile"
"""What is said of a picture of inks."""


def inks_to_colours(paper: NDArray[Any], white: float) -> NDArray[Any]:
    """Return red, green and blue of what inks (CMYK) leave of the paper's white.

    paper: (4, rows, columns), `white` where there is no ink.
    """
    left = paper.astype(np.float64)
    return np.rint(left[:3] * left[3] / white).astype(paper.dtype)
