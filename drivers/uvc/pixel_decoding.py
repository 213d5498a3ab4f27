"""Decode frames into one uint16 number per pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FULL_SCALES = {
    "YUYV": 255,
    "MJPG": 255,
    "GREY": 255,
    "Y10 ": 1023,
    "Y12 ": 4095,
    "Y16 ": 65535,
    "BA81": 255,
    "GBRG": 255,
    "GRBG": 255,
    "RGGB": 255,
}
"""Full-scale digital number of each pixel format, by V4L2's four letters. The last four are raw
mosaics of colour filters; YUYV and MJPG give the luminance."""

_BYTES = {"YUYV": 2, "Y10 ": 2, "Y12 ": 2, "Y16 ": 2}


def is_decoded(pixel_format: str) -> bool:
    """Return whether OpenCV decodes this pixel format; otherwise the raw bytes are used."""
    return pixel_format == "MJPG"


def decode_pixels(image: Any, pixel_format: str, shape: tuple[int, int]) -> NDArray[np.uint16]:
    """Decode a frame to digital numbers (rows, columns); ValueError on a wrong size."""
    if is_decoded(pixel_format):
        return _luminance(image, shape)
    data = np.ascontiguousarray(image).view(np.uint8).reshape(-1)
    rows, columns = shape
    size = _BYTES.get(pixel_format, 1)
    if data.size != rows * columns * size:
        raise ValueError(
            f"a frame of {data.size} bytes came, {columns} x {rows} pixels of "
            f"{pixel_format.strip()} have {rows * columns * size}"
        )
    if pixel_format == "YUYV":
        return data[0::2].reshape(shape).astype(np.uint16)
    if size == 2:
        words = data.view("<u2").reshape(shape).astype(np.uint16)
        if (top := int(words.max())) > FULL_SCALES[pixel_format]:
            raise ValueError(
                f"a frame came whose pixels reach {top}, and {pixel_format.strip()} ends at "
                f"{FULL_SCALES[pixel_format]}: its bytes are in another order or justified left"
            )
        return words
    return data.reshape(shape).astype(np.uint16)


def _luminance(image: Any, shape: tuple[int, int]) -> NDArray[np.uint16]:
    picture = np.asarray(image)
    if picture.shape[:2] != shape:
        raise ValueError(f"a frame of {picture.shape} came instead of {shape}")
    if picture.ndim == 3:
        import cv2

        picture = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    return picture.astype(np.uint16)
