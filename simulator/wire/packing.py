"""Packing of a simulated camera's pictures into the bytes of a pixel format."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.pixel_formats import PixelFormat


def pack_pixels(image: NDArray[np.uint16], form: PixelFormat) -> NDArray[np.uint8]:
    """Pack a picture's pixels into bytes for the simulated GigE wire.

    Numbers are limited to the format's full scale.
    """
    pixels = np.minimum(image.reshape(-1), form.full_scale).astype(np.uint16)
    match form.layout:
        case "bytes":
            return pixels.astype(np.uint8)
        case "words":
            return pixels.astype("<u2").view(np.uint8)
        case "packed":
            return _pack_pairs(pixels, form.bits - 8)
        case "p":
            return _pack_bit_stream(pixels, form.bits)


def _pack_pairs(pixels: NDArray[np.uint16], extra: int) -> NDArray[np.uint8]:
    count = pixels.size
    even = np.append(pixels, np.zeros(count % 2, np.uint16)).reshape(-1, 2)
    low = even & (1 << extra) - 1
    groups = np.stack([even[:, 0] >> extra, low[:, 1] << 4 | low[:, 0], even[:, 1] >> extra], 1)
    return groups.astype(np.uint8).reshape(-1)[: -(-count * 12 // 8)]


def _pack_bit_stream(pixels: NDArray[np.uint16], bits: int) -> NDArray[np.uint8]:
    two_bytes = pixels.astype("<u2").view(np.uint8).reshape(-1, 2)
    ones = np.unpackbits(two_bytes, axis=1, bitorder="little")[:, :bits]
    return np.packbits(ones.reshape(-1), bitorder="little")
