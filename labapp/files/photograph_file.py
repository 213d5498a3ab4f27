"""Read and write the photographs of a restoration: their levels, and the light they stand for."""

from __future__ import annotations

import io
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.array_file import read_npy
from labapp.files.file_lookup import require_readable
from labapp.files.guarded_reading import read_bytes
from labapp.files.picture_decoding import decode_picture
from labapp.files.picture_size import count_pages
from labapp.files.reading import srgb_to_linear
from labapp.files.writing import encode_image

Light = NDArray[np.float32]

_TIFF = (".tif", ".tiff")


@dataclass(frozen=True, eq=False)
class InputPhotograph:
    """A photograph that was read from a file, (bands, rows, columns).

    The bands of a colour photograph are red, green and blue. `levels` are the file's values.
    `is_srgb` says that they are 8-bit sRGB values; otherwise they are linear.
    """

    path: Path
    levels: NDArray[Any]
    is_srgb: bool

    @property
    def light(self) -> Light:
        """The photograph file's values as linear light.

        White is 1 for sRGB values. Other values keep the file's unit.
        """
        if not self.is_srgb:
            return self.levels.astype(np.float32)
        return _SRGB_TO_LINEAR[self.levels]

    def saturation_level(self) -> float | None:
        """Find in a photograph's file the level at which the sensor's wells were full, or None.

        None means that the file shows no sign of full wells. The sign is 3 neighbouring pixels at
        the picture's highest level, if it also has at least twice as many pixels as the level
        below.
        """
        levels = np.where(np.isfinite(self.levels), self.levels, -np.inf)
        top = levels.max()
        at = levels == top
        if at.all() or not (_has_run(at) or _has_run(at.swapaxes(-1, -2))):
            return None
        if np.array_equal(levels, np.rint(levels)):
            below = int((levels == top - 1).sum())
            if int(at.sum()) < 2.0 * below:
                return None
        return float(top)


def read_photograph(
    path: Path, *, linear: bool | None = None, frame: int | None = None
) -> InputPhotograph:
    """Read a photograph from a JPEG, PNG, TIFF or .npy file, grey or colour.

    `linear` says whether levels are proportional to light; by default, they are in all but 8-bit
    pictures. `frame` selects a page of a TIFF of several. Raises UserError if the file is wrong.
    """
    require_readable(path)
    if path.suffix.lower() == ".npy":
        levels, coded = _array(path), False
    else:
        levels = _read_image(path, frame)
        coded = levels.dtype == np.uint8 if linear is None else not linear
        if coded and levels.dtype != np.uint8:
            raise UserError(f"{path}: has {levels.dtype} values; only 8-bit ones are sRGB's.")
    return InputPhotograph(path, levels, coded)


def encode_photograph(path: Path, light: Light, in_srgb: bool, white_level: float) -> bytes:
    """Return the bytes of a photograph's file: floating-point light in .npy and .tiff, or a .png.

    light is (bands, rows, columns). A .png holds 8-bit sRGB values if `in_srgb`, which is meant
    for results of such a picture, else 16-bit linear values. `white_level` is the light of its
    highest level.
    """
    ending = path.suffix.lower()
    shown = light[0] if len(light) == 1 else np.moveaxis(light, 0, -1)
    if ending == ".npy":
        return encode_image(path, shown)
    if ending in _TIFF:
        buffer = io.BytesIO()
        write_float_tiff(buffer, light)
        return buffer.getvalue()
    levels = encode_srgb(shown / white_level) if in_srgb else _encode_16_bit(shown / white_level)
    return encode_image(path, levels[..., ::-1] if levels.ndim == 3 else levels)


def write_float_tiff(file: Path | io.BytesIO, light: Light) -> None:
    """Write light, (bands, rows, columns), to a TIFF file of floating-point numbers."""
    shown = light[0] if len(light) == 1 else np.moveaxis(light, 0, -1)
    kind = "minisblack" if len(light) == 1 else "rgb"
    # A draft's name doesn't end in .tiff.
    with open(file, "wb") if isinstance(file, Path) else nullcontext(file) as opened:
        tifffile.imwrite(opened, np.ascontiguousarray(shown), photometric=kind)


def encode_srgb(light: NDArray[Any]) -> NDArray[np.uint8]:
    """Encode linear light, white at 1, as 8-bit sRGB values for a file (IEC 61966-2-1)."""
    light = np.clip(np.nan_to_num(light), 0, 1)
    levels = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255 * levels).astype(np.uint8)


def _encode_16_bit(light: NDArray[Any]) -> NDArray[np.uint16]:
    return np.rint(65535 * np.clip(np.nan_to_num(light), 0, 1)).astype(np.uint16)


_SRGB_TO_LINEAR = srgb_to_linear(np.linspace(0, 1, 256)).astype(np.float32)
"""Linear light of each 8-bit sRGB level."""


def _has_run(at: NDArray[np.bool_]) -> bool:
    """Return whether 3 neighbouring pixels of a row are set, the file's sign of full wells."""
    side = at.shape[-1] - 2
    if side < 1:
        return False
    run = at[..., :side].copy()
    for step in (1, 2):
        run &= at[..., step : step + side]
    return bool(run.any())


def _array(path: Path) -> NDArray[Any]:
    values = read_npy(path)
    if values.dtype.kind not in "iuf":
        raise UserError(f"{path}: holds {values.dtype} values. Give real numbers.")
    return _bands(path, values)


def _read_image(path: Path, frame: int | None) -> NDArray[Any]:
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR
    data = read_bytes(path)
    image = decode_picture(path, data, flags, _page(path, data, frame))
    if image is None:
        raise UserError(
            f"{path}: is not a picture that can be read. Give a JPEG, PNG, TIFF or .npy."
        )
    return _bands(path, image[..., ::-1] if image.ndim == 3 else image)


def _page(path: Path, data: bytes, frame: int | None) -> int:
    """Return the page of a TIFF file to read, counted from 0."""
    count = count_pages(data)
    if count > 1 and frame is None:
        raise UserError(f"{path}: holds {count} pictures. Name one: --frame 0 to {count - 1}.")
    if frame is not None and not 0 <= frame < max(count, 1):
        raise UserError(f"--frame {frame}: {path} holds {count} pictures, counted from 0.")
    return frame or 0


def _bands(path: Path, values: NDArray[Any]) -> NDArray[Any]:
    """Return a photograph file's values with the bands as the first axis.

    The file has (rows, columns) or (rows, columns, bands).
    """
    if values.ndim == 2:
        bands = values[None]
    elif values.ndim == 3 and values.shape[-1] in (1, 3):
        bands = np.moveaxis(values, -1, 0)
    else:
        raise UserError(
            f"{path}: is {' x '.join(map(str, values.shape))}; give rows x columns, or rows x "
            "columns x 3."
        )
    if not bands.size:
        raise UserError(f"{path}: has no pixels.")
    if not np.isfinite(bands).any():
        raise UserError(f"{path}: has no finite value. Give a picture.")
    return np.ascontiguousarray(bands)
