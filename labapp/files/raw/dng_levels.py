"""What a DNG's tags say of its numbers: area, filters, levels, colours and exposure."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.raw.dng_page import BITS, page_shape
from labapp.files.raw.photograph import CameraColour
from labapp.files.raw.recognition import CFA, PHOTOMETRIC
from labapp.files.tiff_directories import Directory

_LETTERS = "RGBCMYW"
"""Letters of the colours of filters, by TIFF/EP's numbers."""

_TEMPERATURES = {
    1: 5500, 2: 4150, 3: 2850, 4: 5500, 9: 5500, 10: 6500, 11: 7500, 12: 6430, 13: 5000, 14: 4150,
    15: 3450, 17: 2856, 18: 4874, 19: 6774, 20: 5503, 21: 6504, 22: 7504, 23: 5003, 24: 3200,
}  # fmt: skip
"""Correlated colour temperature in kelvin of EXIF's light sources."""

_D65 = 6504
"""Correlated colour temperature of D65 in kelvin, sRGB's white."""

_MATRICES = ((50721, 50778), (50722, 50779), (52531, 52529))
"""Tags of the colour matrices, and of the lights that they are for."""

_REPEAT, _PATTERN, _PLANES, _LAYOUT = 33421, 33422, 50710, 50711
_BLACK_REPEAT, _BLACK, _BLACK_COLUMNS, _BLACK_ROWS = 50713, 50714, 50715, 50716
_WHITE, _TABLE, _AREA, _NEUTRAL, _WHITE_XY, _NOISE = 50717, 50712, 50829, 50728, 50729, 51041

Area = tuple[slice, slice]


def active_area(path: Path, page: Directory) -> Area:
    """Return the rows and columns that see the scene; UserError if they aren't in the picture."""
    rows, columns = page_shape(page)
    area = page.numbers(_AREA)
    top, left, bottom, right = area if len(area) == 4 else (0, 0, rows, columns)
    if len(area) not in (0, 4) or not (0 <= top < bottom <= rows and 0 <= left < right <= columns):
        raise UserError(
            f"{path}: is a DNG whose active area, rows {top} to {bottom} and columns {left} to "
            f"{right}, isn't in its {rows} x {columns} pixels. Convert the camera's file again."
        )
    return slice(int(top), int(bottom)), slice(int(left), int(right))


def filter_pattern(path: Path, page: Directory) -> tuple[str, ...] | None:
    """Return the letters of the filters from the active area's first pixel on; None without.

    Raises UserError for a pattern that isn't stated, or isn't a rectangle of known colours.
    """
    if page.number(PHOTOMETRIC, 0) != CFA:
        return None
    shape, codes = page.numbers(_REPEAT), page.numbers(_PATTERN)
    rows, columns = (int(shape[0]), int(shape[1])) if len(shape) == 2 else (0, 0)
    known = all(code in range(len(_LETTERS)) for code in codes)
    if page.number(_LAYOUT, 1) != 1 or not known or rows * columns != len(codes) or not codes:
        raise UserError(
            f"{path}: is a DNG whose filters can't be told: its pattern is {rows} x {columns} of "
            f"{', '.join(map(str, codes)) or 'nothing'}. Convert the camera's file again."
        )
    letters = "".join(_LETTERS[int(code)] for code in codes)
    return tuple(letters[at : at + columns] for at in range(0, len(letters), columns))


def black_cell(path: Path, page: Directory) -> NDArray[np.float64]:
    """Return the black levels, which repeat from the active area's first pixel on."""
    shape = tuple(int(one) for one in page.numbers(_BLACK_REPEAT)) or (1, 1)
    levels = page.numbers(_BLACK) or (0.0,) * math.prod(shape)
    is_cell = len(shape) == 2 and levels and math.prod(shape) == len(levels)
    if not is_cell or not np.isfinite(levels).all():
        raise UserError(
            f"{path}: is a DNG of {len(levels)} black levels for {' x '.join(map(str, shape))} "
            "places. Convert the camera's file again."
        )
    return np.array(levels, dtype=np.float64).reshape(shape)


def black_changes(
    path: Path, page: Directory, shape: tuple[int, ...]
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """Return what rows and columns have beyond the black levels; None where nothing."""
    found: list[NDArray[np.float64] | None] = []
    for code, count, name in zip(
        (_BLACK_ROWS, _BLACK_COLUMNS), shape, ("rows", "columns"), strict=True
    ):
        values = np.array(page.numbers(code), dtype=np.float64)
        if values.size not in (0, count) or not np.isfinite(values).all():
            raise UserError(
                f"{path}: is a DNG with black levels for {values.size} {name} of {count}. Convert "
                "the camera's file again."
            )
        found.append(values if values.any() else None)
    return found[0], found[1]


def linear_table(page: Directory) -> NDArray[np.uint16] | None:
    """Return the table by which stored numbers become linear; None if they are."""
    return np.array(table, dtype=np.uint16) if (table := page.numbers(_TABLE)) else None


def white_level(page: Directory) -> float:
    """Return the number of a full well, by default the highest that can be stored."""
    highest = (1 << page.number(BITS, 16)) - 1
    if (table := linear_table(page)) is not None:
        highest = int(table[-1])
    return float((page.numbers(_WHITE) or (highest,))[0])


def camera_colour(page: Directory, first: Directory, channels: str) -> CameraColour:
    """Return what is stated of the camera's colours, in the order of `channels`."""
    # The colours in the order in which the tags have them.
    codes = page.numbers(_PLANES) or (0, 1, 2)
    letters = "".join(_LETTERS[int(code)] for code in codes if code in range(len(_LETTERS)))
    if set(letters) != set(channels):
        return CameraColour()
    order = [letters.index(letter) for letter in channels]
    matrix, kelvin = _matrix_nearest_d65(first, len(letters))
    white = np.array(first.numbers(_NEUTRAL), dtype=np.float64)
    xy = first.numbers(_WHITE_XY)
    if white.size != len(letters) and len(xy) == 2 and xy[1] > 0 and matrix is not None:
        white = matrix @ (np.array([xy[0], xy[1], 1 - xy[0] - xy[1]]) / xy[1])
    noise = None
    values = np.array(page.numbers(_NOISE), dtype=np.float64)
    if values.size in (2, 2 * len(order)) and (values >= 0).all():
        pairs = values.reshape(-1, 2)
        noise = np.repeat(pairs, len(order), 0) if len(pairs) == 1 else pairs[order]
    sound = white.size == len(letters) and bool((white > 0).all() and np.isfinite(white).all())
    return CameraColour(
        None if matrix is None else matrix[order],
        f"{kelvin} K" if matrix is not None else "",
        white[order] if sound else None,
        noise,
    )


def _matrix_nearest_d65(first: Directory, count: int) -> tuple[NDArray[np.float64] | None, int]:
    """Return the colour matrix for the light nearest to D65, and its temperature in kelvin."""
    found = [
        (_TEMPERATURES.get(first.number(light, 0), 0), np.array(first.numbers(code)))
        for code, light in _MATRICES
        if len(first.numbers(code)) == 3 * count
    ]
    sound = [(kelvin, one) for kelvin, one in found if np.isfinite(one).all() and one.any()]
    if not sound:
        return None, 0
    # Lights are as far apart as their inverse temperatures, as DNG weighs its matrices.
    kelvin, values = min(sound, key=lambda one: abs(1 / max(one[0], 1) - 1 / _D65))
    return values.reshape(count, 3).astype(np.float64), kelvin
