"""One word for how a picture's levels stand for light, and the curves behind the words.

Levels are the numbers of a file over the number of white, so that white is 1; light is 1 there,
too. The curves of sRGB and BT.709 begin with a straight line, which goes on below 0.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.plain_text import quote

Numbers = NDArray[Any]
Curve = Callable[[Numbers], Numbers]

CHOICES = "linear, srgb, bt709, gamma 2.2 (or another number), pq or hlg"
"""Names of encodings, in words."""

_GAMMA = re.compile(r"gamma\s*([0-9]{1,2}(?:\.[0-9]{1,10})?)")
_LEAST_GAMMA, _MOST_GAMMA = 0.1, 10.0
"""Exponents that a picture can be encoded by: displays have 1.8 to 2.8. Chosen."""

_OTHER_NAMES = {"rec709": "bt709", "bt.709": "bt709", "rec.709": "bt709"}
_TABLE_BYTES = 2
"""Bytes of the integers, at most, whose light is looked up in a table."""

_BLOCK = 1 << 20
"""Numbers that are turned into light at once, to bound the memory used in between to some 30 MB.
Chosen."""


@dataclass(frozen=True, eq=False)
class Encoding:
    """How levels stand for light.

    name: "linear", "srgb" (IEC 61966-2-1), "bt709" (ITU-R BT.709-6), "pq" and "hlg" (ITU-R
    BT.2100-2), "gamma X" (light is the level to the power of X), or "icc".
    curves: for "icc", the light at evenly spaced levels from 0 to 1, (1, nodes), or (3, nodes) for
    red, green and blue.
    """

    name: str
    curves: NDArray[np.float64] | None = None

    def to_light(self, levels: Numbers) -> Numbers:
        """Return the light that levels stand for, as the levels' type of floating-point numbers.

        levels: (rows, columns), or (bands, rows, columns) where each band has a curve of its own.
        """
        if self.curves is not None:
            return _each_band(self.curves, levels, np.linspace(0, 1, self.curves.shape[1]))
        return _keep_type(_curves(self.name)[0], levels)

    def from_light(self, light: Numbers) -> Numbers:
        """Return the levels that stand for light: the inverse of `to_light`.

        Raises UserError if a profile's curve doesn't rise throughout.
        """
        if self.curves is None:
            return _keep_type(_curves(self.name)[1], light)
        if (np.diff(self.curves) < 0).any():
            raise UserError("the curve of the ICC profile falls, so that no level can be found.")
        nodes = np.linspace(0, 1, self.curves.shape[1])
        return _each_band(nodes[None], light, self.curves)


class Statement(NamedTuple):
    """What is stated of an encoding: None where nothing is; `source` is who states it.

    refusal: why it can't be turned into light, in words; empty if it can.
    """

    encoding: Encoding | None
    source: str = ""
    notes: tuple[str, ...] = ()
    refusal: str = ""


def statement_of(read: Callable[[], Statement]) -> Statement:
    """Return what is stated of an encoding; what can't be turned into light is a refusal.

    Whoever names the encoding needs no word of the file's.
    """
    try:
        return read()
    except UserError as error:
        return Statement(None, refusal=str(error))


LINEAR, SRGB, BT709, PQ, HLG = (Encoding(name) for name in ("linear", "srgb", "bt709", "pq", "hlg"))


def gamma_encoding(exponent: float) -> Encoding:
    """Return the encoding of levels whose power is light; "linear" for an exponent of 1."""
    return LINEAR if exponent == 1 else Encoding(f"gamma {exponent:.10g}")


def parse_encoding(text: str) -> Encoding:
    """Return the encoding that a text names; raise UserError for other words."""
    word = " ".join(text.lower().split())
    word = _OTHER_NAMES.get(word, word)
    if word in _CURVES:
        return Encoding(word)
    found = _GAMMA.fullmatch(word)
    if found and _LEAST_GAMMA <= float(found[1]) <= _MOST_GAMMA:
        return gamma_encoding(float(found[1]))
    raise UserError(f"encoding is {quote(text)}. Choose {CHOICES}.")


def decode_levels(levels: Numbers, white: float | None, encoding: Encoding) -> NDArray[np.float32]:
    """Convert levels to light, white at 1; linear levels without a white keep theirs.

    levels: (bands, rows, columns), numbers of any type.
    white: number of white, or None for floating-point numbers, whose white is 1.
    """
    scale = 1.0 if white is None else float(white)
    if encoding.name == "linear":
        return np.divide(levels, scale, dtype=np.float32, casting="unsafe")
    light = np.empty(levels.shape, np.float32)
    # The light of every integer of up to 16 bits, (curves, integers).
    tables = None
    if levels.dtype.kind == "u" and levels.dtype.itemsize <= _TABLE_BYTES:
        every = np.arange(np.iinfo(levels.dtype).max + 1) / scale
        count = 1 if encoding.curves is None else len(encoding.curves)
        every = np.broadcast_to(every, (count, every.size))
        tables = encoding.to_light(every).astype(np.float32)
        if 1 < count != len(levels):
            raise UserError(
                f"an ICC profile of {count} colours belongs to a grey picture; convert it."
            )
        tables = np.broadcast_to(tables, (len(levels), every.shape[1]))
    rows = max(1, _BLOCK // max(1, levels[:, 0].size))
    for start in range(0, levels.shape[1], rows):
        part = slice(start, start + rows)
        if tables is None:
            light[:, part] = encoding.to_light(levels[:, part].astype(np.float64) / scale)
        else:
            for band, table in enumerate(tables):
                light[band, part] = table[levels[band, part]]
    return light


def decode_srgb(levels: Numbers) -> Numbers:
    """Convert sRGB values to linear light, both from 0 to 1 (IEC 61966-2-1)."""
    # Above the line, the clipping only keeps a power of negative numbers from being taken.
    power = ((np.maximum(levels, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(levels <= 0.04045, levels / 12.92, power)


def encode_srgb(light: Numbers) -> Numbers:
    """Convert linear light to sRGB values, both from 0 to 1 (IEC 61966-2-1)."""
    power = 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, power)


_ALPHA, _BETA = 1.099296826809442, 0.018053968510807
"""Constants with which BT.709's line and power meet, unrounded (ITU-T H.273, table 3)."""


def _decode_bt709(levels: Numbers) -> Numbers:
    """Return a scene's light by the inverse of BT.709's camera curve (ITU-R BT.709-6, item 1.2)."""
    power = ((np.maximum(levels, 4.5 * _BETA) + _ALPHA - 1) / _ALPHA) ** (1 / 0.45)
    return np.where(levels < 4.5 * _BETA, levels / 4.5, power)


def _encode_bt709(light: Numbers) -> Numbers:
    power = _ALPHA * np.maximum(light, _BETA) ** 0.45 - (_ALPHA - 1)
    return np.where(light < _BETA, 4.5 * light, power)


_MOST_LEVEL = 1.5
"""Level above which light stays the same by the two steepest curves: one of them ends at 1.92.
Chosen."""

_M1, _M2 = 2610 / 16384, 2523 / 4096 * 128
_C1, _C2, _C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
"""Constants of the perceptual quantizer (ITU-R BT.2100-2, table 4)."""


def _decode_pq(levels: Numbers) -> Numbers:
    """Return the light of a display, 1 at 10000 cd/m² (ITU-R BT.2100-2, table 4)."""
    root = np.clip(levels, 0, _MOST_LEVEL) ** (1 / _M2)
    return (np.maximum(root - _C1, 0) / (_C2 - _C3 * root)) ** (1 / _M1)


def _encode_pq(light: Numbers) -> Numbers:
    root = np.maximum(light, 0) ** _M1
    return ((_C1 + _C2 * root) / (1 + _C3 * root)) ** _M2


_A = 0.17883277
_B, _C = 1 - 4 * _A, 0.5 - _A * math.log(4 * _A)
"""Constants of hybrid log-gamma (ITU-R BT.2100-2, table 5)."""


def _decode_hlg(levels: Numbers) -> Numbers:
    """Return a scene's light by the inverse of the camera curve (ITU-R BT.2100-2, table 5)."""
    above = (np.exp((np.clip(levels, 0.5, _MOST_LEVEL) - _C) / _A) + _B) / 12
    return np.where(levels <= 0.5, np.maximum(levels, 0) ** 2 / 3, above)


def _encode_hlg(light: Numbers) -> Numbers:
    above = _A * np.log(12 * np.maximum(light, 1 / 12) - _B) + _C
    return np.where(light <= 1 / 12, np.sqrt(3 * np.maximum(light, 0)), above)


_CURVES: dict[str, tuple[Curve, Curve]] = {
    "linear": (lambda levels: levels, lambda light: light),
    "srgb": (decode_srgb, encode_srgb),
    "bt709": (_decode_bt709, _encode_bt709),
    "pq": (_decode_pq, _encode_pq),
    "hlg": (_decode_hlg, _encode_hlg),
}
"""Functions from levels to light and back, by the name of the encoding."""


def _curves(name: str) -> tuple[Curve, Curve]:
    """Return the functions from levels to light and back of an encoding without a table."""
    if name in _CURVES:
        return _CURVES[name]
    exponent = float(name.removeprefix("gamma "))
    return (
        lambda levels: np.maximum(levels, 0) ** exponent,
        lambda light: np.maximum(light, 0) ** (1 / exponent),
    )


def _keep_type(curve: Curve, numbers: Numbers) -> Numbers:
    """Return a curve's values for numbers, float32 for float32 and float64 for all others."""
    numbers = np.asarray(numbers)
    kept = numbers if numbers.dtype == np.float32 else numbers.astype(np.float64)
    return curve(kept).astype(kept.dtype, copy=False)


def _each_band(values: Numbers, numbers: Numbers, nodes: Numbers) -> Numbers:
    """Interpolate each band's curve linearly at numbers, clipped to the curve's ends.

    values: (1 or 3, n). nodes: (n,), or (1 or 3, n) that rise.
    """
    numbers = np.asarray(numbers)
    nodes = np.atleast_2d(nodes)
    count = max(len(values), len(nodes))
    if count == 1:
        found = np.interp(numbers, nodes[0], values[0])
    elif numbers.ndim < 2 or len(numbers) != count:
        raise UserError(f"an ICC profile of {count} colours belongs to a grey picture; convert it.")
    else:
        curves = np.broadcast_arrays(nodes, values)
        found = np.stack([np.interp(*one) for one in zip(numbers, *curves, strict=True)])
    return found.astype(np.float32 if numbers.dtype == np.float32 else np.float64, copy=False)
