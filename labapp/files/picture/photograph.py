"""Photographs as they were read: levels, the light they stand for, and what their file says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.array_file import read_npy, read_npz
from labapp.files.exif import SRGB as SRGB_BY_EXIF
from labapp.files.exif import Exif
from labapp.files.guarded_reading import read_bytes
from labapp.files.picture.encoding import LINEAR, SRGB, Encoding, decode_levels
from labapp.files.picture.opening import count_pages, read_stored
from labapp.files.picture.stored import StoredPicture
from labapp.files.raw.photograph import saturated_level

Light = NDArray[np.float32]

_TURNS = {
    2: "mirrored left to right", 3: "turned by 180°", 4: "mirrored top to bottom",
    5: "mirrored and turned by 90°", 6: "turned by 90° clockwise",
    7: "mirrored and turned by 270°", 8: "turned by 90° counterclockwise",
}  # fmt: skip
"""How a picture is to be shown upright, by its orientation (Exif 2.32, section 4.6.4)."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph as it was read, in the sensor's order.

    levels: (bands, rows, columns), the file's numbers; one band, or red, green and blue.
    encoding: how the levels stand for light; encoding_source: who says so, in words.
    white: number of white; None for floating-point numbers.
    orientation: 1 to 8, as Exif counts them, which is told and never applied, because the PSF that
    belongs to the photograph isn't turned either.
    exposure: what the camera noted, or None; notes: what was done or left out.
    """

    path: Path
    levels: NDArray[Any]
    encoding: Encoding = LINEAR
    encoding_source: str = ""
    white: float | None = None
    kind: str = "array"
    orientation: int = 1
    is_lossy: bool = False
    exposure: Exif | None = None
    notes: tuple[str, ...] = ()

    @property
    def is_coded(self) -> bool:
        """Whether the levels aren't proportional to light."""
        return self.encoding.name != "linear"

    @property
    def light(self) -> Light:
        """The levels as linear light: white is 1 for coded ones, linear ones keep their unit.

        Raises UserError if that is too far from 1 for single precision.
        """
        if self.is_coded:
            return self.relative_light
        with np.errstate(over="ignore", under="ignore"):
            light = self.levels.astype(np.float32)
        if self.levels.dtype.kind == "f":
            limits = np.finfo(np.float32)
            least, most = float(limits.tiny), float(limits.max)
            brightest = float(np.abs(self.levels[np.isfinite(self.levels)]).max())
            if brightest > most or 0 < brightest < least:
                raise UserError(
                    f"{self.path}: its largest value is {brightest:.3g}, and single precision "
                    f"holds {least:.2g} to {most:.2g}. Give its light in another unit."
                )
        return light

    @property
    def relative_light(self) -> Light:
        """The levels as linear light, white at 1; floating point as it is."""
        return decode_levels(self.levels, self.white, self.encoding)

    @property
    def remarks(self) -> tuple[str, ...]:
        """How the numbers were read, in words, where that isn't plain."""
        if self.orientation == 1:
            return self.notes
        told = (
            f"by its orientation it is to be shown {_TURNS[self.orientation]}; the sensor's order "
            "was kept, which is that of its PSF"
        )
        return (*self.notes, told)

    def saturation_level(self) -> float | None:
        """Find the level at which the sensor's wells were full; None if there is no sign of it."""
        return saturated_level([*np.where(np.isfinite(self.levels), self.levels, -np.inf)])


def read_photograph(
    path: Path,
    *,
    encoding: Encoding | None = None,
    unstated: Encoding | None = None,
    page: int | None = None,
    page_option: str = "",
) -> Photograph:
    """Read a grey or colour photograph from a picture or .npy.

    path: of any format in `labapp.files.picture.opening.FORMATS`.
    encoding: how the numbers stand for light; by default what the file says.
    unstated: how they do where the file doesn't say it; by default sRGB's curve in 8-bit pictures,
    and proportional in all others.
    page: which of several pictures is meant, from 0.
    page_option: the command's option that names the page, for messages.
    Raises UserError if the file can't be read rightly, or holds several pictures and none is named.
    """
    data = read_bytes(path)
    if not data:
        raise UserError(f"{path}: is empty. Give a picture.")
    if path.suffix.lower() in (".npy", ".npz") or data.startswith(b"\x93NUMPY"):
        stored = _read_array(path)
    else:
        stored = read_stored(path, data, _page(path, data, page, page_option))
    missing = _note_missing(path, stored.values)
    found, source = _choose_encoding(path, stored, encoding, unstated)
    return Photograph(
        path, np.ascontiguousarray(stored.values), found, source, stored.white, stored.kind,
        stored.orientation, stored.is_lossy, stored.exif,
        (*stored.notes, *missing),
    )  # fmt: skip


def _choose_encoding(
    path: Path, stored: StoredPicture, given: Encoding | None, unstated: Encoding | None
) -> tuple[Encoding, str]:
    """Return the encoding that is given, or the file's, or that of its numbers; and who says so."""
    if given is not None:
        return given, "as told"
    if stored.encoding_refusal:
        raise UserError(f"{path}: {stored.encoding_refusal}")
    found = stored.encoding
    if found is not None:
        if found.curves is not None and len(found.curves) not in (1, len(stored.values)):
            raise UserError(
                f"{path}: is grey, and its ICC profile is one of colours. Name its encoding."
            )
        return found, stored.encoding_source
    if stored.values.dtype.kind == "f":
        return LINEAR, "floating-point numbers are proportional to light"
    if stored.exif is not None and stored.exif.colour_space == SRGB_BY_EXIF:
        return SRGB, "its Exif block"
    if unstated is not None:
        return unstated, "as such files are without a word on it"
    if stored.white == 255 and stored.values.dtype == np.uint8:
        return SRGB, "8-bit pictures without a word on it are sRGB"
    return LINEAR, "numbers of more than 8 bits without a word on it are proportional to light"


def _page(path: Path, data: bytes, page: int | None, option: str) -> int:
    """Return which of several pictures to read, counted from 0."""
    count = count_pages(path, data)
    if count > 1 and page is None:
        remedy = "Save the one that is meant as a file of its own."
        if option:
            remedy = f"Name one: {option} 0 to {count - 1}."
        raise UserError(f"{path}: holds {count} pictures. {remedy}")
    if page is not None and not 0 <= page < count:
        raise UserError(
            f"{option or 'page'} {page}: {path} holds {count} pictures, counted from 0."
        )
    return page or 0


def _read_array(path: Path) -> StoredPicture:
    """Read an array of NumPy, whose numbers are proportional to light."""
    if path.suffix.lower() == ".npz":
        arrays = read_npz(path)
        if len(arrays) != 1:
            raise UserError(
                f"{path}: is an .npz of {len(arrays)} arrays: {', '.join(arrays) or 'none'}. Save "
                "the one that is meant as .npy."
            )
        (values,) = arrays.values()
    else:
        values = read_npy(path)
    if values.dtype.kind not in "iuf":
        raise UserError(f"{path}: holds {values.dtype} values. Give real numbers.")
    if values.ndim == 2:
        bands = values[None]
    elif values.ndim == 3 and values.shape[-1] in (1, 3):
        bands = np.moveaxis(values, -1, 0)
    else:
        raise UserError(
            f"{path}: is {' x '.join(map(str, values.shape))}; give rows x columns, or rows x "
            "columns x 3, and no further dimensions."
        )
    white = None if values.dtype.kind == "f" else float(np.iinfo(values.dtype).max)
    told = "arrays are proportional to light"
    return StoredPicture(bands, "array", white, LINEAR, told)


def _note_missing(path: Path, values: NDArray[Any]) -> tuple[str, ...]:
    """Say how many numbers aren't finite; raise UserError for a picture of no others."""
    if not values.size:
        raise UserError(f"{path}: has no pixels. Give a picture.")
    if values.dtype.kind != "f":
        return ()
    finite = int(np.count_nonzero(np.isfinite(values)))
    if not finite:
        raise UserError(f"{path}: has no finite value. Give a picture.")
    count = values.size - finite
    told = f"{count} of its numbers are infinite or NaN, and count as missing pixels"
    return (told,) if count else ()
