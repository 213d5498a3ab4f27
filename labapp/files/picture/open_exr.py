"""OpenEXR: which channels of which part are light, and what the header says of them.

Its library prints what it thinks of damaged files, and then leaves parts out without an error. What
it says is kept from the terminal, and is the error.
"""

from __future__ import annotations

import io
import math
import re
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.library_text import collect_library_text
from labapp.common.plain_text import printable_line, quote
from labapp.files.exif import Exif
from labapp.files.guarded_reading import require_memory
from labapp.files.picture.encoding import LINEAR
from labapp.files.picture.stored import StoredPicture

_SAID = re.compile(rb"[^\n]*\(EXR_ERR_\w+\)[^\n]*\n?|Warning: Exception raised reading[^\n]*\n?")
"""Lines that the library prints of damaged files."""


def open_exr(path: Path, data: bytes, header_only: bool) -> list[Any]:
    """Return a file's parts as the library reads them; UserError if it finds damage."""
    import OpenEXR

    with collect_library_text(_SAID) as said:
        try:
            file = OpenEXR.File(io.BytesIO(data), separate_channels=True, header_only=header_only)
            parts = list(file.parts)
        # Damage also leads to texts that aren't UTF-8, and to sizes that no memory holds.
        except (RuntimeError, ValueError, TypeError, MemoryError, OSError) as error:
            raise damaged_exr(path) from error
    if said or not parts:
        raise damaged_exr(path)
    return parts


def encode_open_exr(light: NDArray[np.float32]) -> bytes:
    """Return the bytes of light as OpenEXR, (1 or 3, rows, columns), exact in float32.

    One band is written as luminance (Y), three as R, G and B with the primaries of sRGB.
    """
    import OpenEXR

    names = ("R", "G", "B") if len(light) == 3 else ("Y",)
    channels = {
        name: OpenEXR.Channel(np.ascontiguousarray(band, dtype=np.float32))
        for name, band in zip(names, light, strict=True)
    }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    file = io.BytesIO()
    OpenEXR.File(header, channels).write(file)
    return file.getvalue()


def damaged_exr(path: Path) -> UserError:
    """Return the error that says that an OpenEXR file is damaged."""
    return UserError(f"{path}: is a damaged or incomplete OpenEXR file. Get it again.")


_COLOURS, _CHROMA = ("R", "G", "B"), ("RY", "BY")

_SRGB = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
"""Places of red, green, blue and white in x and y where a file states none: those of sRGB."""

_SAME_PLACE = 0.002
"""Highest difference of x and y that counts as the same. Chosen: rounding to three digits."""

_LOSSY = ("B44_COMPRESSION", "B44A_COMPRESSION", "DWAA_COMPRESSION", "DWAB_COMPRESSION")
_LOSSY_FOR_FLOATS = "PXR24_COMPRESSION"
"""Compressions that change numbers: always, or only those of 32 bits ("Technical Introduction to
OpenEXR", Data Compression)."""

_MOST_IN_TILE = 1 << 22
"""Pixels that a tile may have in a smaller picture: 2048 x 2048; programs write up to 512 x 512.
Chosen."""

_NEEDED = {"channels", "compression", "dataWindow", "displayWindow"}

_NUMBERS = {"float16": "half", "float32": "float", "uint32": "whole numbers"}


def read_open_exr(path: Path, data: bytes, page: int = 0) -> StoredPicture:
    """Read a part of OpenEXR: red, green and blue, or one channel, as they are stored.

    page: number of the part.
    Raises UserError if the file is damaged, or holds another picture than one of light: deep
    samples, luminance with chroma, several layers.
    """
    headers = _read_headers(path, data)
    if not 0 <= page < len(headers):
        raise UserError(f"{path}: holds {len(headers)} pictures, counted from 0. Name one of them.")
    header = headers[page]
    if "deep" in getattr(header.get("type"), "name", ""):
        raise UserError(
            f"{path}: is a deep OpenEXR file, with several samples a pixel. Flatten it in the "
            "program that made it."
        )
    names, notes = _choose_channels(path, header["channels"])
    _require_size(path, data, headers)
    values = _read_channels(path, data, len(headers), page, names)
    if values.shape[1:] != _size(header, "dataWindow"):
        raise damaged_exr(path)
    kind = _NUMBERS.get(values.dtype.name, values.dtype.name)
    compression = header["compression"].name
    is_lossy = compression in _LOSSY or (
        compression == _LOSSY_FOR_FLOATS and values.dtype == np.float32
    )
    return StoredPicture(
        values, f"OpenEXR, {kind}", None, LINEAR, "its format", len(headers),
        exif=_exposure(header), is_lossy=is_lossy,
        notes=tuple(notes + _note_windows(header) + _note_colours(header)),
    )  # fmt: skip


def count_exr_pages(path: Path, data: bytes) -> int:
    """Return how many parts there are; raise UserError if the OpenEXR is damaged."""
    return len(_read_headers(path, data))


def _read_headers(path: Path, data: bytes) -> list[dict[str, Any]]:
    """Return the headers of all parts, which have size, channels and compression."""
    headers = [part.header for part in open_exr(path, data, header_only=True)]
    if not all({*one} >= _NEEDED for one in headers):
        raise damaged_exr(path)
    try:
        # A name is decoded when it's asked for, and may be no text.
        _ = [channel.name for header in headers for channel in header["channels"]]
    except UnicodeDecodeError as error:
        raise damaged_exr(path) from error
    return headers


def _choose_channels(path: Path, channels: list[Any]) -> tuple[tuple[str, ...], list[str]]:
    """Return the names of the channels of light, and notes of what is left out."""
    names = [channel.name for channel in channels]
    wanted, notes = _find_light(path, names)
    if any((one.xSampling, one.ySampling) != (1, 1) for one in channels if one.name in wanted):
        raise UserError(
            f"{path}: is an OpenEXR file whose channels have fewer samples than pixels. Save it "
            "with all samples of R, G and B."
        )
    alpha = [name for name in names if name == "A" or name.endswith(".A")]
    others = [name for name in names if name not in (*wanted, *alpha)]
    if alpha:
        notes.append("its transparency was left out: its light is what is there, as the format is")
    if others:
        shown = ", ".join(printable_line(name) for name in others[:8])
        more = f" and {len(others) - 8} more" if len(others) > 8 else ""
        notes.append(f"its channels {shown}{more} were left out")
    return wanted, notes


def _find_light(path: Path, names: list[str]) -> tuple[tuple[str, ...], list[str]]:
    """Return the channels of light among a part's channels: R, G and B, Y, or the only one."""
    if set(_COLOURS) <= set(names):
        return _COLOURS, []
    if "Y" in names and not set(_CHROMA) & set(names):
        return ("Y",), []
    if len(names) == 1:
        return (names[0],), [f"its only channel, {quote(names[0])}, was taken as grey"]
    if set(_CHROMA) & set(names):
        raise UserError(
            f"{path}: is an OpenEXR file of luminance and chroma (Y, RY, BY). Save it with R, G "
            "and B."
        )
    layers = [name[:-2] for name in names if all(f"{name[:-2]}.{one}" in names for one in _COLOURS)]
    found = sorted(set(layers))
    if len(found) == 1:
        return (
            tuple(f"{found[0]}.{one}" for one in _COLOURS),
            [f"its layer {quote(found[0])} was taken as the picture"],
        )
    what = "the layers" if found else "the channels"
    shown = ", ".join(printable_line(one) for one in (found or names)[:8])
    raise UserError(
        f"{path}: is an OpenEXR file of {what} {shown}, none of which is the picture by its name. "
        "Save one with R, G and B, or with Y."
    )


def _require_size(path: Path, data: bytes, headers: list[dict[str, Any]]) -> None:
    """Raise UserError if all parts, all of which are read, are much larger than the file."""
    pixels = whole = 0
    for header in headers:
        rows, columns = _size(header, "dataWindow")
        tile = header.get("tiles")
        if rows < 1 or columns < 1:
            raise damaged_exr(path)
        # A tile is decoded whole.
        if tile and tile.xSize * tile.ySize > max(_MOST_IN_TILE, rows * columns):
            raise damaged_exr(path)
        pixels += rows * columns
        # Four bytes hold any of the format's numbers.
        whole += 4 * rows * columns * len(header["channels"])
    require_memory(path, len(data), whole, "its picture", pixels=pixels)


def _size(header: dict[str, Any], window: str) -> tuple[int, int]:
    """Return rows and columns of a part's window, whose corners both belong to it."""
    (left, top), (right, bottom) = ([int(one) for one in corner] for corner in header[window])
    return bottom - top + 1, right - left + 1


def _read_channels(
    path: Path, data: bytes, count: int, page: int, names: tuple[str, ...]
) -> NDArray[Any]:
    """Return the numbers of a part's channels, (channels, rows, columns)."""
    parts = open_exr(path, data, header_only=False)
    if len(parts) != count:
        raise damaged_exr(path)
    channels = parts[page].channels
    if not set(names) <= set(channels):
        raise damaged_exr(path)
    bands = [channels[name].pixels for name in names]
    if len({band.shape for band in bands}) != 1 or bands[0].ndim != 2:
        raise damaged_exr(path)
    return np.stack(bands)


def _exposure(header: dict[str, Any]) -> Exif | None:
    """Return what a part's header says of its exposure ("Standard Optional Attributes")."""

    def positive(name: str) -> float | None:
        value = header.get(name)
        number = float(value) if isinstance(value, float | int) else math.nan
        return number if math.isfinite(number) and number > 0 else None

    def text(name: str) -> str:
        value = header.get(name)
        return value if isinstance(value, str) else ""

    try:
        taken = datetime.strptime(text("capDate"), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        taken = None
    found = Exif(
        positive("expTime"), positive("aperture"), positive("isoSpeed"),
        maker=text("cameraMake"), model=text("cameraModel"), taken=taken,
    )  # fmt: skip
    return None if found == Exif() else found


def _note_windows(header: dict[str, Any]) -> list[str]:
    """Return notes if the pixels that a part has aren't those that it's meant to show."""
    notes, told = [], []
    for window in ("dataWindow", "displayWindow"):
        rows, columns = _size(header, window)
        left, top = (int(one) for one in header[window][0])
        told.append(f"{columns} x {rows} pixels from column {left} and row {top} on")
    found, shown = told
    if found != shown:
        notes.append(f"all its {found} were read, of which it means to show {shown}")
    aspect = float(header.get("pixelAspectRatio", 1.0))
    if not abs(aspect - 1) < 1e-3:
        notes.append(f"its pixels are {aspect:.4g} times as wide as high, which was not undone")
    return notes


def _note_colours(header: dict[str, Any]) -> list[str]:
    """Return a note if a part's primaries aren't sRGB's."""
    stated = header.get("chromaticities")
    if stated is None:
        return []
    places = np.ravel(np.array(stated, dtype=np.float64))
    if places.shape == (8,) and np.allclose(places, _SRGB, rtol=0, atol=_SAME_PLACE):
        return []
    return ["its colours have other primaries than sRGB (chromaticities); they are kept"]
