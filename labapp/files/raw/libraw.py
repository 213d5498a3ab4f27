"""Decoding by LibRaw, and keeping what it has to say away from the terminal.

LibRaw goes on after damage, fills what it can't decode with zeros, and writes a line to standard
error. Such a line is what tells a damaged file from a sound one.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.library_text import collect_library_text
from labapp.files.guarded_reading import require_memory

if TYPE_CHECKING:
    import rawpy

MESSAGE = re.compile(rb"^[^\n]*: (Unexpected end of file|data corrupted at -?\d+)\s*$", re.M)
"""Lines that LibRaw writes to standard error."""

_ORIENTATIONS = {0: 1, 1: 2, 2: 4, 3: 3, 4: 5, 5: 8, 6: 6, 7: 7}
"""Orientation in EXIF by LibRaw's flips: 1 mirrors columns, 2 rows, and 4 exchanges both."""


@dataclass(frozen=True, eq=False)
class LibRawPicture:
    """What LibRaw read; levels, colours and orientation are as in RawPhotograph.

    mosaic: all pixels, masked ones included; None for several numbers a pixel.
    visible: rows and columns that see the scene, where `pattern` begins.
    matrix: from XYZ to the camera's channels, (4, 3); balance: by what the camera multiplies them
    to make white, (4,); zeros where they aren't known. letters: of their rows.
    exposure: exposure time in seconds, aperture and sensitivity; 0 where they aren't known.
    messages: what LibRaw wrote to standard error.
    """

    mosaic: NDArray[np.uint16] | None
    visible: tuple[slice, slice]
    pattern: tuple[str, ...] | None
    black: NDArray[np.float64]
    white: float
    linear_limit: float | None
    matrix: NDArray[np.float64]
    letters: str
    balance: NDArray[np.float64]
    orientation: int
    exposure: tuple[float, float, float]
    messages: tuple[str, ...]


def decode_by_libraw(path: Path, data: bytes) -> LibRawPicture | str:
    """Decode any camera's bytes; if LibRaw can't, return what it says about them.

    Raises UserError if the picture would be much larger than its file.
    """
    import rawpy

    with collect_library_text(MESSAGE) as messages:
        try:
            with rawpy.RawPy() as raw:
                raw.open_buffer(io.BytesIO(data))
                sizes = raw.sizes
                whole = 2 * sizes.raw_height * sizes.raw_width
                require_memory(path, len(data), whole, "its mosaic")
                raw.unpack()
                found = _gather(raw)
        except (rawpy.LibRawError, rawpy.NotSupportedError, ValueError, RuntimeError) as error:
            told = error.args[0] if error.args else ""
            text = told.decode("ascii", "replace") if isinstance(told, bytes) else str(told)
            return text.rstrip(".")
    return LibRawPicture(**found, messages=tuple(messages))


def _gather(raw: rawpy.RawPy) -> dict[str, Any]:
    """Return what LibRaw decoded, by the names of `LibRawPicture`."""
    import rawpy

    sizes, letters = raw.sizes, raw.color_desc.decode("ascii", "replace")
    top, left = sizes.top_margin, sizes.left_margin
    visible = slice(top, top + sizes.height), slice(left, left + sizes.width)
    is_flat = raw.raw_type == rawpy.RawType.Flat and raw.raw_image is not None
    indices = raw.raw_pattern if is_flat else None
    levels = np.array(raw.black_level_per_channel, dtype=np.float64)
    has_filters = indices is not None and int(indices.max()) < len(letters) and indices.size > 1
    pattern, black = None, levels[:1, None]
    if has_filters:
        assert indices is not None
        pattern = tuple("".join(letters[one] for one in row) for row in indices)
        black = levels[indices]
    limits = raw.camera_white_level_per_channel
    known = [level for level in limits or () if 0 < level < raw.white_level]
    about = raw.other
    return {
        "mosaic": raw.raw_image.copy() if is_flat else None,
        "visible": visible,
        "pattern": pattern,
        "black": black,
        "white": float(raw.white_level),
        "linear_limit": float(min(known)) if known else None,
        "matrix": np.array(raw.rgb_xyz_matrix, dtype=np.float64),
        "letters": letters,
        "balance": np.array(raw.camera_whitebalance, dtype=np.float64),
        "orientation": _ORIENTATIONS.get(sizes.flip, 1),
        "exposure": (about.shutter_speed, about.aperture, about.iso_speed),
    }


def require_undamaged(path: Path, picture: LibRawPicture) -> None:
    """Raise UserError if LibRaw met damage, or its last row is nothing but zeros."""
    if picture.messages:
        raise UserError(
            f"{path}: is a RAW file that is cut or damaged ({picture.messages[0]}), so that a part "
            "of its picture is missing. Copy it from the camera again."
        )
    if picture.mosaic is None:
        return
    # Noise keeps a row of a sensor from being 0 throughout; what wasn't decoded is.
    if not picture.mosaic[picture.visible][-1:].any():
        share = float((picture.mosaic == 0).mean())
        raise UserError(
            f"{path}: is a RAW file of which {share:.0%} comes as 0, to the last row: it is cut, "
            "damaged or empty. Copy it from the camera again."
        )
