"""Photographs to write, so that what is written says how its numbers stand for light."""

from __future__ import annotations

import io
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from labapp.files.picture import encoding
from labapp.files.picture.encoding import LINEAR, SRGB
from labapp.files.picture.icc import icc_profile
from labapp.files.picture.photograph import Light
from labapp.files.picture.stated_encoding import png_with_encoding
from labapp.files.writing import encode_image

_TIFF = (".tif", ".tiff")
_ICC = 34675
"""Tag of a colour profile in TIFF (ICC.1, annex B.4)."""


def encode_photograph(path: Path, light: Light, in_srgb: bool, white_level: float) -> bytes:
    """Return a photograph's bytes in the format that the ending names.

    light: (bands, rows, columns).
    .npy, .tiff, .exr and .hdr hold floating-point light. A .png holds 8-bit sRGB values if
    `in_srgb`, which is meant for results of such a picture, else 16-bit linear values, and says
    which; `white_level` is the light of its highest level.
    """
    ending = path.suffix.lower()
    if ending == ".npy":
        return encode_image(path, _pixels(light))
    if ending in _TIFF:
        buffer = io.BytesIO()
        write_float_tiff(buffer, light)
        return buffer.getvalue()
    if ending == ".exr":
        from labapp.files.picture.open_exr import encode_open_exr

        return encode_open_exr(light)
    if ending == ".hdr":
        from labapp.files.picture.radiance import encode_radiance

        return encode_radiance(light)[0]
    shown = _pixels(light) / white_level
    if in_srgb:
        return encode_png(path, encode_srgb(shown), in_srgb)
    levels = np.rint(65535 * np.clip(np.nan_to_num(shown), 0, 1)).astype(np.uint16)
    return encode_png(path, levels, in_srgb)


def encode_png(path: Path, levels: NDArray[Any], in_srgb: bool) -> bytes:
    """Return the bytes of a PNG of levels, (rows, columns[, 3]), that says its encoding."""
    plain = encode_image(path, levels[..., ::-1] if levels.ndim == 3 else levels)
    return png_with_encoding(plain, SRGB if in_srgb else LINEAR)


def linear_tiff(frame: NDArray[Any]) -> dict[str, Any]:
    """Return what tifffile.imwrite is told of grey frames, (…, rows, columns), for linear numbers.

    8-bit ones get a profile, without which they would be taken for sRGB's.
    """
    told: dict[str, Any] = {"photometric": "minisblack"}
    if frame.dtype == np.uint8:
        profile = icc_profile(LINEAR, bands=1)
        told["extratags"] = [(_ICC, 7, len(profile), profile, True)]
    return told


def write_float_tiff(file: Path | io.BytesIO, light: Light) -> None:
    """Write light, (bands, rows, columns), to a TIFF of floating-point numbers."""
    kind = "minisblack" if len(light) == 1 else "rgb"
    # A draft's name doesn't end in .tiff.
    with open(file, "wb") if isinstance(file, Path) else nullcontext(file) as opened:
        tifffile.imwrite(opened, np.ascontiguousarray(_pixels(light)), photometric=kind)


def encode_srgb(light: NDArray[Any]) -> NDArray[np.uint8]:
    """Encode linear light, white at 1, as 8-bit sRGB values (IEC 61966-2-1)."""
    light = np.clip(np.nan_to_num(light), 0, 1)
    return np.rint(255 * encoding.encode_srgb(light)).astype(np.uint8)


def _pixels(light: Light) -> NDArray[Any]:
    """Return light as (rows, columns) or (rows, columns, bands)."""
    return light[0] if len(light) == 1 else np.moveaxis(light, 0, -1)
