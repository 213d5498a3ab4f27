"""Radiance HDR: red, green and blue of 8 bits that share an exponent.

See G. Ward, "Real Pixels" (Graphics Gems II, 1991), and the reference manual of Radiance's file
formats (radiance-online.org, filefmts.pdf). A pixel's light is its mantissas times 2^(E - 136), as
imagecodecs and OpenCV decode it.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.plain_text import quote
from labapp.files.guarded_reading import require_memory
from labapp.files.picture.encoding import LINEAR, Encoding, gamma_encoding
from labapp.files.picture.stored import StoredPicture

_MOST_HEADER = 1 << 16
"""Bytes of a header that are looked at; scripts write their command lines there. Chosen."""

_SIZE = re.compile(rb"([+-])([XY]) {1,3}([0-9]{1,9}) {1,3}([+-])([XY]) {1,3}([0-9]{1,9})")

_ORIENTATIONS = {b"-Y+X": 1, b"-Y-X": 2, b"+Y-X": 3, b"+Y+X": 4} | {
    b"+X-Y": 5, b"-X-Y": 6, b"-X+Y": 7, b"+X+Y": 8
}  # fmt: skip
"""Exif's orientation by the axes along which rows, then columns are counted; Y goes up."""

_KNOWN_PRIMARIES = (
    (0.64, 0.33, 0.29, 0.6, 0.15, 0.06, 0.3333, 0.3333),
    (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329),
)
"""Places of red, green, blue and white in x and y: Radiance's own, and sRGB's."""

_BIAS = 136
"""Exponent of a mantissa of 1 in units: 128, and 8 for the mantissa's bits."""

_LEAST, _MOST = 1e-32, 255 * 2.0**119
"""Light below which Radiance's programs write black, and the highest that fits, 1.7e38."""

_MOST_IN_RUN = 64
"""Bytes that a byte can stand for: 2 bytes are a run of up to 127."""

_BLOCK = 1 << 18
"""Pixels that are rounded at once, to bound the memory used in between to some 10 MB. Chosen."""

_HEADER = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"


def read_radiance(path: Path, data: bytes, page: int = 0) -> StoredPicture:
    """Read Radiance HDR as light, in the order of its rows.

    Values are divided by the exposures and colour corrections that the header says were applied.
    Raises UserError if the file is damaged or cut, or holds other colours than RGB.
    """
    if page:
        raise UserError(f"{path}: holds 1 picture, counted from 0.")
    lines, body = _split_header(path, data)
    found = _SIZE.fullmatch(lines[-1])
    orientation = _ORIENTATIONS.get(b"".join(found.group(1, 2, 4, 5))) if found else None
    if not found or orientation is None:
        raise _damaged(path, f"its size is {quote(lines[-1].decode('latin-1'))}")
    rows, columns = int(found[3]), int(found[6])
    if not rows * columns:
        raise _damaged(path, "it has no pixels")
    pixels = rows * columns
    require_memory(path, len(data), 12 * pixels, "its picture", pixels=pixels)
    light = np.moveaxis(_decode_pixels(path, body, rows, columns), -1, 0)
    scale, encoding, notes = _read_variables(path, lines[:-1])
    if (scale != 1).any():
        with np.errstate(over="ignore"):
            light = light / scale.astype(np.float32)[:, None, None]
    source = "its format" if encoding is LINEAR else "its GAMMA"
    return StoredPicture(
        np.ascontiguousarray(light), "Radiance HDR", None, encoding, source,
        orientation=orientation, notes=tuple(notes),
    )  # fmt: skip


def encode_radiance(light: NDArray[np.float32]) -> tuple[bytes, tuple[str, ...]]:
    """Return the bytes of Radiance HDR, and notes of what it couldn't hold.

    light: (1 or 3, rows, columns); grey is written as equal red, green and blue.
    Numbers are rounded to 8 bits below the brightest of a pixel's colours. Negative ones become 0.
    Raises UserError if a number is not finite, or above 1.7e38.
    """
    import imagecodecs

    if not np.isfinite(light).all() or light.max() > _MOST:
        raise UserError(
            f"Radiance HDR holds numbers up to {_MOST:.2g}, and the picture has others. Write "
            "OpenEXR or TIFF."
        )
    negative = float((light < 0).mean())
    rows, columns = light.shape[1:]
    rounded = np.empty((rows, columns, 3), np.float32)
    step = max(1, _BLOCK // columns)
    for start in range(0, rows, step):
        part = slice(start, start + step)
        rounded[part] = _round_pixels(np.moveaxis(np.maximum(light[:, part], 0), 0, -1))
    # It cuts mantissas off, which does nothing to numbers that fit.
    pixels = imagecodecs.rgbe_encode(rounded, header=False, rle=True)
    told = f"{100 * negative:.3g} % of its numbers are negative, and 0 in Radiance HDR"
    return _HEADER + b"-Y %d +X %d\n" % (rows, columns) + pixels, (told,) if negative else ()


def _round_pixels(colours: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the nearest numbers that 8 bits with a shared exponent hold; colours are last."""
    brightest = colours.max(axis=-1, keepdims=True)
    _, exponent = np.frexp(np.maximum(brightest, np.float32(_LEAST)))
    # A mantissa that rounds up to 256 takes the next exponent.
    # Powers of two multiply float32 without rounding.
    one = np.float32(1)
    exponent += np.rint(brightest * np.ldexp(one, 8 - exponent)) > 255
    rounded = np.rint(colours * np.ldexp(one, 8 - exponent)) * np.ldexp(one, exponent - 8)
    return np.where(brightest < _LEAST, np.float32(0), rounded)


def _split_header(path: Path, data: bytes) -> tuple[list[bytes], bytes]:
    """Return the lines of a header, the last of which is the size, and the bytes of the pixels."""
    head, blank, _ = data[:_MOST_HEADER].partition(b"\n\n")
    start = len(head) + 2
    end = data.find(b"\n", start, start + 100)
    if not blank or end < 0:
        raise _damaged(path, "its header has no end")
    return [*head.split(b"\n"), data[start:end].strip()], data[end + 1 :]


def _read_variables(
    path: Path, lines: list[bytes]
) -> tuple[NDArray[np.float64], Encoding, list[str]]:
    """Return what values are to be divided by (3,), their encoding, and notes, from a header."""
    scale, encoding, notes = np.ones(3), LINEAR, []
    for line in lines:
        name, _, value = line.decode("latin-1").partition("=")
        name, value = name.strip(), value.strip()
        if name == "FORMAT" and value != "32-bit_rle_rgbe":
            raise UserError(
                f"{path}: is a Radiance picture of the format {quote(value)}, and not of red, "
                "green and blue. Convert it with Radiance's ra_xyze -r."
            )
        count = {"EXPOSURE": 1, "COLORCORR": 3, "PRIMARIES": 8, "GAMMA": 1}.get(name)
        if count is None:
            continue
        numbers = _numbers(value)
        if len(numbers) != count or (count < 8 and min(numbers) <= 0):
            raise _damaged(path, f"its {name} is {quote(value)}")
        if name in ("EXPOSURE", "COLORCORR"):
            scale = scale * np.array(numbers)
            notes.append(f"its numbers were divided by its {name}, {value}")
        elif name == "GAMMA":
            encoding = gamma_encoding(numbers[0])
        elif not any(np.allclose(numbers, one, rtol=0, atol=0.006) for one in _KNOWN_PRIMARIES):
            notes.append("its colours have other primaries than sRGB (PRIMARIES); they are kept")
    if not np.isfinite(scale).all() or not ((scale > 1e-30) & (scale < 1e30)).all():
        raise _damaged(path, "its exposures multiply to no sensible number")
    return scale, encoding, notes


def _numbers(text: str) -> list[float]:
    """Return the finite numbers of a variable; none if one of them is no number."""
    try:
        found = [float(one) for one in text.split()]
    except ValueError:
        return []
    return found if all(map(math.isfinite, found)) else []


def _decode_pixels(path: Path, body: bytes, rows: int, columns: int) -> NDArray[np.float32]:
    """Return the pixels' light, (rows, columns, 3)."""
    if body[:2] == b"\2\2" and 8 <= columns < 32768 and body[2:3] < b"\x80":
        return _decode_runs(path, body, rows, columns)
    pixels = _expand_old_runs(path, body, rows * columns)
    exponents = np.where(pixels[:, 3] == 0, -1000, pixels[:, 3].astype(np.int32) - _BIAS)
    light = np.ldexp(pixels[:, :3].astype(np.float64), exponents[:, None])
    return light.astype(np.float32).reshape(rows, columns, 3)


def _decode_runs(path: Path, body: bytes, rows: int, columns: int) -> NDArray[np.float32]:
    """Return the light of pixels that are stored colour by colour, in runs."""
    import imagecodecs

    if 4 * rows * columns > _MOST_IN_RUN * len(body):
        raise _damaged(path, "its pixels end early")
    try:
        found = imagecodecs.rgbe_decode(_HEADER + b"-Y %d +X %d\n" % (rows, columns) + body)
    except (imagecodecs.RgbeError, ValueError, RuntimeError) as error:
        raise _damaged(path, "its pixels end early, or can't be expanded") from error
    if found.shape != (rows, columns, 3):
        raise _damaged(path, "its pixels aren't as many as its header says")
    return found


def _expand_old_runs(path: Path, body: bytes, count: int) -> NDArray[np.uint8]:
    """Return pixels (count, 4) that are stored one after the other, some of them as runs.

    A pixel 1, 1, 1, n repeats the one before n times; directly after such a one, n counts 256s.
    """
    stored = np.frombuffer(body, np.uint8, len(body) // 4 * 4).reshape(-1, 4)
    runs = (stored[:, :3] == 1).all(axis=1)
    if not runs.any():
        if len(stored) != count:
            raise _damaged(path, "its pixels aren't as many as its header says")
        return stored
    repeats = np.ones(len(stored), np.int64)
    last, shift = -2, 0
    for at in np.flatnonzero(runs).tolist():
        shift = min(shift + 8, 24) if at == last + 1 else 0
        repeats[at], last = int(stored[at, 3]) << shift, at
    if runs[0] or repeats.sum() != count:
        raise _damaged(path, "its pixels aren't as many as its header says")
    origin = np.maximum.accumulate(np.where(runs, 0, np.arange(len(stored))))
    return np.repeat(stored[origin], repeats, axis=0)


def _damaged(path: Path, why: str) -> UserError:
    return UserError(f"{path}: is damaged Radiance HDR: {why}. Get the file again.")
