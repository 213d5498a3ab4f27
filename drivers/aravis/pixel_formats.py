"""Unpack the pixel formats of GigE Vision and USB3 Vision cameras into whole numbers.

Names, codes and layouts follow the public "GenICam Pixel Format Naming Convention" 2.1 and
"Pixel Format Values" (EMVA); the packed formats follow "GigE Vision" 1.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Layout = Literal["bytes", "words", "p", "packed"]
ByteOrder = Literal["little", "big"]
Justification = Literal["right", "left"]


@dataclass(frozen=True)
class PixelFormat:
    """How pixels are sent.

    code: the format's number on the wire. bits: significant bits of a pixel. layout: "bytes" and
    "words" have one pixel in 8 or 16 bits, least significant byte first; "p" is a stream of bits
    without gaps, least significant first; "packed" has two pixels in three bytes, with the low
    bits of both in the middle one. bayer: the colours of the first two pixels of a mosaic, empty
    without a mosaic. byte_order, justification: how a camera sends "words" as its user says; empty
    for the convention's rule, least significant byte first and justified right.
    """

    name: str
    code: int
    bits: int
    layout: Layout
    bayer: str
    byte_order: ByteOrder | Literal[""] = ""
    justification: Justification | Literal[""] = ""

    @property
    def shift(self) -> int:
        """Bits by which words are above the pixels' numbers."""
        return 16 - self.bits if self.justification == "left" else 0

    @property
    def group(self) -> int:
        """Number of pixels that end on a whole byte."""
        return {"bytes": 1, "words": 1, "p": 4 if self.bits == 10 else 2, "packed": 2}[self.layout]

    @property
    def full_scale(self) -> int:
        return 2**self.bits - 1

    def byte_count(self, shape: tuple[int, int]) -> int:
        """Return the number of bytes in a picture of this shape (rows, columns)."""
        return -(-shape[0] * shape[1] * _pixel_bits(self) // 8)


def _pixel_bits(form: PixelFormat) -> int:
    return {"bytes": 8, "words": 16, "p": form.bits, "packed": 12}[form.layout]


def _formats() -> dict[str, PixelFormat]:
    rows: list[tuple[str, int, int, Layout]] = [
        ("Mono8", 0x01080001, 8, "bytes"),
        ("Mono10", 0x01100003, 10, "words"),
        ("Mono10Packed", 0x010C0004, 10, "packed"),
        ("Mono12", 0x01100005, 12, "words"),
        ("Mono12Packed", 0x010C0006, 12, "packed"),
        ("Mono14", 0x01100025, 14, "words"),
        ("Mono16", 0x01100007, 16, "words"),
        ("Mono10p", 0x010A0046, 10, "p"),
        ("Mono12p", 0x010C0047, 12, "p"),
    ]
    for place, pattern in enumerate(("GR", "RG", "GB", "BG")):
        rows += [
            (f"Bayer{pattern}8", 0x01080008 + place, 8, "bytes"),
            (f"Bayer{pattern}10", 0x0110000C + place, 10, "words"),
            (f"Bayer{pattern}12", 0x01100010 + place, 12, "words"),
            (f"Bayer{pattern}10Packed", 0x010C0026 + place, 10, "packed"),
            (f"Bayer{pattern}12Packed", 0x010C002A + place, 12, "packed"),
            (f"Bayer{pattern}16", 0x0110002E + place, 16, "words"),
        ]
    for place, pattern in enumerate(("BG", "GB", "GR", "RG")):
        rows += [
            (f"Bayer{pattern}10p", 0x010A0052 + 2 * place, 10, "p"),
            (f"Bayer{pattern}12p", 0x010C0053 + 2 * place, 12, "p"),
        ]
    return {
        name: PixelFormat(name, code, bits, layout, name[5:7] if name[0] == "B" else "")
        for name, code, bits, layout in rows
    }


FORMATS = _formats()
"""The pixel formats that can be unpacked, by their names."""


def unpack(
    data: NDArray[np.uint8], pixel_format: PixelFormat, shape: tuple[int, int]
) -> NDArray[np.uint16]:
    """Unpack a frame's bytes into a picture (rows, columns), which is a copy.

    ValueError if there are fewer bytes than the picture needs.
    """
    size = pixel_format.byte_count(shape)
    if data.size < size:
        raise ValueError(f"{data.size} bytes; a {pixel_format.name} picture of {shape} has {size}")
    pixels = _UNPACKERS[pixel_format.layout](data[:size], pixel_format.bits, shape[0] * shape[1])
    if pixel_format.byte_order == "big":
        pixels = pixels.byteswap()
    if pixel_format.shift:
        pixels >>= pixel_format.shift
    return pixels.reshape(shape)


def unpack_lines(
    data: NDArray[np.uint8], pixel_format: PixelFormat, shape: tuple[int, int], stride: int
) -> NDArray[np.uint16]:
    """Unpack a frame whose lines begin `stride` bytes apart; the bytes between are left.

    ValueError if there are fewer bytes than the picture needs.
    """
    rows, columns = shape
    line = pixel_format.byte_count((1, columns))
    if data.size < (rows - 1) * stride + line:
        raise ValueError(f"{data.size} bytes; {rows} lines of {stride} bytes were told")
    starts = range(0, rows * stride, stride)
    lines = [data[start : start + line] for start in starts]
    if pixel_format.layout in ("bytes", "words") or columns % pixel_format.group == 0:
        return unpack(np.concatenate(lines), pixel_format, shape)
    return np.vstack([unpack(one, pixel_format, (1, columns)) for one in lines])


def _unpack_bytes(data: NDArray[np.uint8], bits: int, count: int) -> NDArray[np.uint16]:
    return data.astype(np.uint16)


def _unpack_words(data: NDArray[np.uint8], bits: int, count: int) -> NDArray[np.uint16]:
    return data.view("<u2").astype(np.uint16)


def _byte_groups(data: NDArray[np.uint8], length: int, pixels: int, count: int) -> Any:
    """Return the bytes in groups of `length`, and an empty array for the pixels.

    Each group holds `pixels` pixels. The last group is filled up with zeros.
    """
    groups = -(-count // pixels)
    if data.size < groups * length:
        data = np.concatenate([data, np.zeros(groups * length - data.size, np.uint8)])
    room = np.empty((groups, pixels), np.uint16)
    return data.reshape(groups, length).T.astype(np.uint16), room


def _unpack_packed(data: NDArray[np.uint8], bits: int, count: int) -> NDArray[np.uint16]:
    (first, low, second), room = _byte_groups(data, 3, 2, count)
    extra = bits - 8
    mask = (1 << extra) - 1
    room[:, 0] = first << extra | low & mask
    room[:, 1] = second << extra | low >> 4 & mask
    return room.reshape(-1)[:count]


def _unpack_bit_stream(data: NDArray[np.uint8], bits: int, count: int) -> NDArray[np.uint16]:
    # Four pixels of 10 bits take 5 bytes; two pixels of 12 bits take 3.
    length, pixels = (5, 4) if bits == 10 else (3, 2)
    parts, room = _byte_groups(data, length, pixels, count)
    for pixel in range(pixels):
        byte, shift = divmod(pixel * bits, 8)
        room[:, pixel] = (parts[byte] >> shift | parts[byte + 1] << 8 - shift) & (1 << bits) - 1
    return room.reshape(-1)[:count]


_UNPACKERS = {
    "bytes": _unpack_bytes,
    "words": _unpack_words,
    "packed": _unpack_packed,
    "p": _unpack_bit_stream,
}
