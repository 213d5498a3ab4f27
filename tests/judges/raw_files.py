"""DNG files made from arrays by tifffile, which says what is in them, with what a camera states."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import imagecodecs
import numpy as np
import tifffile
from numpy.typing import NDArray

Mosaic = NDArray[Any]

CODES = {"R": 0, "G": 1, "B": 2, "C": 3, "M": 4, "Y": 5, "W": 6}
BLACK_REPEAT, BLACK, WHITE, AREA = 50713, 50714, 50717, 50829

# Letters of the types of TIFF: bytes, text, 16 and 32 bits, rational, signed rational, double.
TYPES = {"b": 1, "s": 2, "h": 3, "l": 4, "r": 5, "q": 10, "d": 12}

Tags = Mapping[int, tuple[str, Any]]


def dng(
    mosaic: Mosaic,
    pattern: Sequence[str] | None = ("RG", "GB"),
    *,
    bits: int | None = None,
    storage: str = "plain",
    order: str = "<",
    part: tuple[int, int] | None = None,
    tags: Tags | None = None,
    camera: Tags | None = None,
    photometric: int | None = None,
    version: bool = True,
) -> bytes:
    """The bytes of a DNG: a grey preview, and a mosaic in a directory below it.

    storage: plain, packed, deflate, or ljpeg of one or two components. part: shape of a tile; or
    rows of a strip and 0. tags stand with the mosaic, and camera's with the preview.
    """
    own = dict(tags or {})
    if pattern is not None:
        own[33421] = ("h", (len(pattern), len(pattern[0])))
        own[33422] = ("b", bytes(CODES[letter] for letter in "".join(pattern)))
    main = {50706: ("b", bytes([1, 4, 0, 0]))} if version else {}
    main |= {271: ("s", "Judge"), 272: ("s", "Box"), **(camera or {})}
    how: dict[str, Any] = {}
    if part is not None:
        how |= {"tile": part} if part[1] else {"rowsperstrip": part[0]}
    data: Any = mosaic
    if storage == "plain":
        pass
    elif storage == "packed":
        how |= {"bitspersample": bits}
    elif storage == "deflate":
        how |= {"compression": "deflate", "predictor": True}
    else:
        how |= {"compression": 7, "shape": mosaic.shape, "dtype": mosaic.dtype}
        how = {"rowsperstrip": len(mosaic)} | how if part is None else how
        data = ljpeg_parts(mosaic, bits or 16, int(storage[-1]), part)
    kind = "cfa" if pattern is not None else "minisblack" if mosaic.ndim == 2 else "rgb"
    file = io.BytesIO()
    with tifffile.TiffWriter(file, byteorder=order) as writer:
        preview = np.full((24, 30), 99, np.uint8)
        writer.write(
            preview, photometric="minisblack", subfiletype=1, subifds=1, metadata=None,
            extratags=listed(main),
        )  # fmt: skip
        writer.write(
            data, photometric=kind, subfiletype=0, metadata=None, extratags=listed(own), **how
        )
    found = file.getvalue()
    if storage == "packed":
        found = with_packed(found, mosaic, bits or 16)
    if storage.startswith("ljpeg"):
        found = with_number(found, 258, bits or 16)
    return found if photometric is None else with_number(found, 262, photometric)


def listed(tags: Tags) -> list[tuple[int, int, int | None, Any, bool]]:
    """Tags as tifffile takes them; rational numbers as parts of a million."""
    said = []
    for code, (kind, value) in tags.items():
        many = value if isinstance(value, tuple | list | bytes | str | np.ndarray) else (value,)
        count: int | None = len(many)
        if kind in "rq":
            many = tuple(n for one in many for n in (round(float(one) * 1_000_000), 1_000_000))
        if kind == "s":
            count = None
        said.append((code, TYPES[kind], count, many if kind in "bs" else tuple(many), True))
    return said


def ljpeg_parts(
    mosaic: Mosaic, bits: int, components: int, part: tuple[int, int] | None
) -> Iterator[bytes]:
    """Strips or tiles as lossless JPEG; tiles reach beyond the picture, and are 0 there."""
    rows, columns = mosaic.shape
    down, along = (part[0], part[1] or columns) if part else mosaic.shape
    for top in range(0, rows, down):
        for left in range(0, columns, along):
            cut = mosaic[top : top + down, left : left + along]
            if part and part[1]:
                cut = np.pad(cut, ((0, down - cut.shape[0]), (0, along - cut.shape[1])))
            yield ljpeg(np.ascontiguousarray(cut), bits, components)


def ljpeg(part: Mosaic, bits: int, components: int) -> bytes:
    """A part of a mosaic as lossless JPEG; of two components, a pair of pixels is one of JPEG's."""
    if components == 1:
        return imagecodecs.ljpeg_encode(part, bitspersample=bits)
    pairs = part.reshape(part.shape[0], -1, 2)
    return imagecodecs.jpeg_encode(pairs, lossless=True, bitspersample=bits)


def raw_page(file: tifffile.TiffFile) -> tifffile.TiffPage:
    """The mosaic's page."""
    return file.pages[0].pages[0]


def with_packed(data: bytes, mosaic: Mosaic, bits: int) -> bytes:
    """The file with its numbers packed here, the highest bit first (TIFF 6.0, FillOrder 1).

    tifffile 2026.3 exchanges bytes of such numbers when it writes big-endian files.
    """
    places = np.arange(bits)[::-1]
    packed = np.packbits((mosaic[..., None] >> places & 1).reshape(len(mosaic), -1), axis=1)
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        at = raw_page(file).dataoffsets[0]
    return data[:at] + packed.tobytes() + data[at + packed.size :]


def with_number(data: bytes, code: int, value: int) -> bytes:
    """The file with another number in a tag of the mosaic's directory."""
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        tag = raw_page(file).tags[code]
        name = "little" if file.byteorder == "<" else "big"
        at, size = tag.valueoffset, {3: 2, 4: 4}[int(tag.dtype)]
    return data[:at] + value.to_bytes(size, name) + data[at + size :]


def data_offset(data: bytes) -> int:
    """Where the mosaic's numbers begin in the file."""
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        return raw_page(file).dataoffsets[0]
