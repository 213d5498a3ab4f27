"""Kinds of PNG files, written chunk by chunk from the specification (W3C, third edition)."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from judges.picture_files.icc import PROPHOTO_COLUMNS, grey_profile, icc_profile
from judges.picture_files.tiff_page_kinds import DAMAGED
from judges.picture_files.truth import (
    Maker,
    Numbers,
    PictureFile,
    add_kind,
    quantised,
    save,
    scene,
)

GREY, RGB, PALETTE, GREY_ALPHA, RGBA = 0, 2, 3, 4, 6

_PASSES = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2))
_PASSES = (*_PASSES, (1, 0, 2, 1))
"""First row and column, and steps, of Adam7."""

_OPEN = ("srgb", "linear")
"""A PNG of 16 bits that doesn't tell its transfer leaves it to the reader."""

_ALPHA = ("alpha", "transparen")

Chunk = tuple[bytes, bytes]


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png_bytes(
    samples: Numbers,
    bits: int,
    colour: int,
    rng: np.random.Generator,
    *,
    interlaced: bool = False,
    before: tuple[Chunk, ...] = (),
    pieces: int = 1,
) -> bytes:
    """A PNG of (rows, columns, samples), every row filtered by a filter drawn at random."""
    rows, columns = samples.shape[:2]
    head = struct.pack(">IIBBBBB", columns, rows, bits, colour, 0, 0, int(interlaced))
    raw = b""
    for row, column, down, right in _PASSES if interlaced else ((0, 0, 1, 1),):
        raw += _filtered(samples[row::down, column::right], bits, rng)
    data = zlib.compress(raw, 6)
    step = -(-len(data) // pieces)
    chunks = [(b"IHDR", head), *before]
    chunks += [(b"IDAT", data[i : i + step]) for i in range(0, len(data), step)]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*c) for c in [*chunks, (b"IEND", b"")])


def _filtered(samples: Numbers, bits: int, rng: np.random.Generator) -> bytes:
    """Rows of bytes behind the number of their filter."""
    if not samples.size:
        return b""
    flat = samples.reshape(len(samples), -1)
    if bits == 16:
        lines = np.ascontiguousarray(flat.astype(">u2")).view(np.uint8)
    elif bits == 8:
        lines = flat.astype(np.uint8)
    else:
        ones = (flat[..., None] >> np.arange(bits - 1, -1, -1)) & 1
        lines = np.packbits(ones.astype(np.uint8).reshape(len(flat), -1), axis=1)
    step = max(1, samples.shape[2] * bits // 8)
    left = np.pad(lines, ((1, 0), (step, 0))).astype(int)
    x, a, b, c = left[1:, step:], left[1:, :-step], left[:-1, step:], left[:-1, :-step]
    p = a + b - c
    pa, pb, pc = abs(p - a), abs(p - b), abs(p - c)
    paeth = np.where((pa <= pb) & (pa <= pc), a, np.where(pb <= pc, b, c))
    by_filter = np.stack([x, x - a, x - b, x - (a + b) // 2, x - paeth])
    chosen = rng.integers(0, 5, len(lines))
    picked = by_filter[chosen, np.arange(len(lines))].astype(np.uint8)
    return np.concatenate([chosen[:, None].astype(np.uint8), picked], 1).tobytes()


@dataclass(frozen=True)
class PngKind:
    """A PNG of a random scene."""

    bits: int = 8
    colour: int = RGB
    interlaced: bool = False
    chunks: tuple[Chunk, ...] = ()
    encodings: tuple[str, ...] = ()
    transfer: Callable[[Numbers], Numbers] | None = None
    pieces: int = 1
    orientation: int = 1
    ending: str = ".png"
    tail: bytes = b""
    must_name: tuple[str, ...] = ()
    must_tell: tuple[str, ...] = ()

    def __call__(self, rng: np.random.Generator, path: Path) -> PictureFile:
        bands, extra = (3 if self.colour & 2 else 1), self.colour in (GREY_ALPHA, RGBA)
        before, white = self.chunks, 2.0**self.bits - 1
        if self.colour == PALETTE:
            index = quantised(scene(rng, 1), self.bits)
            table = rng.integers(0, 256, (3, int(index.max()) + 1)).astype(np.uint8)
            numbers, stored, white = table[:, index[0]], index, 255.0
            # A palette stands before the transparency of its colours.
            at = next((i for i, c in enumerate(before) if c[0] == b"tRNS"), len(before))
            before = (*before[:at], (b"PLTE", table.T.tobytes()), *before[at:])
        else:
            stored = quantised(scene(rng, bands + extra), self.bits)
            numbers = stored[:bands]
        data = png_bytes(
            np.moveaxis(stored, 0, -1),
            self.bits,
            self.colour,
            rng,
            interlaced=self.interlaced,
            before=before,
            pieces=self.pieces,
        )
        seen = any(c[0] == b"tRNS" for c in before) or extra
        usual = ("srgb",) if self.bits == 8 or self.colour == PALETTE else _OPEN
        light = self.transfer(numbers / white) if self.transfer else None
        return PictureFile(
            save(path, self.ending, data + self.tail),
            numbers,
            () if self.transfer else self.encodings or usual,
            white,
            light=light,
            orientation=self.orientation,
            must_name=self.must_name + (_ALPHA if seen else ()),
            must_tell=self.must_tell or (_ALPHA if seen else ()),
        )


def _iccp(profile: bytes) -> Chunk:
    return b"iCCP", b"made by hand\0\0" + zlib.compress(profile)


def _gama(exponent: float) -> Chunk:
    return b"gAMA", struct.pack(">I", round(exponent * 100000))


def exif(orientation: int) -> bytes:
    """Exif's TIFF of one tag."""
    return b"MM\0*\0\0\0\x08\0\1" + struct.pack(">HHIHH", 274, 3, 1, orientation, 0) + bytes(4)


def _pq(values: Numbers) -> Numbers:
    """SMPTE ST 2084: share of 10 000 cd/m²."""
    m1, m2, c1, c2, c3 = 0.1593017578125, 78.84375, 0.8359375, 18.8515625, 18.6875
    power = values ** (1 / m2)
    return (np.maximum(power - c1, 0) / (c2 - c3 * power)) ** (1 / m1)


_SRGB = (b"sRGB", b"\0")
_KINDS: dict[str, PngKind] = {
    "interlaced RGB": PngKind(interlaced=True),
    "interlaced RGB of 16 bits": PngKind(16, interlaced=True),
    "interlaced palette of 4 bits": PngKind(4, PALETTE, interlaced=True),
    "interlaced grey and alpha of 16 bits": PngKind(16, GREY_ALPHA, interlaced=True),
    "many pieces of data": PngKind(pieces=23),
    "transparent grey": PngKind(8, GREY, chunks=((b"tRNS", b"\0\x80"),)),
    "transparent grey of 16 bits": PngKind(16, GREY, chunks=((b"tRNS", b"\x80\x80"),)),
    "transparent RGB": PngKind(chunks=((b"tRNS", b"\0\x80\0\x80\0\x80"),)),
    "transparent RGB of 16 bits": PngKind(16, chunks=((b"tRNS", bytes(6)),)),
    "transparent palette": PngKind(8, PALETTE, chunks=((b"tRNS", bytes(range(0, 200, 10))),)),
    "gAMA 1": PngKind(chunks=(_gama(1),), encodings=("linear",), must_name=("gama",)),
    "gAMA 1, 16 bits": PngKind(16, chunks=(_gama(1),), encodings=("linear",)),
    "gAMA 1/2.2": PngKind(
        16, chunks=(_gama(1 / 2.2),), transfer=lambda v: v**2.2, must_name=("gama",)
    ),
    "gAMA 1/1.8": PngKind(chunks=(_gama(1 / 1.8),), transfer=lambda v: v**1.8, must_name=("gama",)),
    "sRGB": PngKind(chunks=(_SRGB, _gama(1 / 2.2)), encodings=("srgb",)),
    "sRGB, 16 bits": PngKind(16, chunks=(_SRGB,), encodings=("srgb",)),
    "sRGB, grey of 16 bits": PngKind(16, GREY, chunks=(_SRGB,), encodings=("srgb",)),
    "ICC linear": PngKind(chunks=(_iccp(icc_profile(1)),), encodings=("linear",)),
    "ICC linear, 16 bits": PngKind(16, chunks=(_iccp(icc_profile(1)),), encodings=("linear",)),
    "ICC sRGB, 16 bits": PngKind(16, chunks=(_iccp(icc_profile("srgb")),), encodings=("srgb",)),
    "ICC grey of gamma 1.8": PngKind(
        16,
        GREY,
        chunks=(_iccp(grey_profile(1.8)),),
        transfer=lambda v: v ** (461 / 256),
        must_name=("icc", "profile"),
    ),
    "ICC of ProPhoto's colours": PngKind(
        16,
        chunks=(_iccp(icc_profile(1.8, PROPHOTO_COLUMNS)),),
        transfer=lambda v: v ** (461 / 256),
        must_name=("icc", "profile"),
        must_tell=("icc", "profile", "primar", "colour"),
    ),
    "cICP sRGB, 16 bits": PngKind(16, chunks=((b"cICP", b"\1\x0d\0\1"),), encodings=("srgb",)),
    "cICP linear": PngKind(chunks=((b"cICP", b"\1\x08\0\1"),), encodings=("linear",)),
    "cICP PQ": PngKind(
        16,
        chunks=((b"cICP", b"\x09\x10\0\1"),),
        transfer=_pq,
        must_name=("cicp", "pq", "2084", "2100"),
    ),
    "cICP before gAMA": PngKind(
        16, chunks=((b"cICP", b"\1\x08\0\1"), _gama(1 / 2.2)), encodings=("linear",)
    ),
    "sBIT": PngKind(16, chunks=((b"sBIT", b"\x0c\x0c\x0c"),)),
    "orientation 6 in eXIf": PngKind(chunks=((b"eXIf", exif(6)),), orientation=6),
    "orientation 3 in eXIf, 16 bits": PngKind(16, chunks=((b"eXIf", exif(3)),), orientation=3),
    "text and background": PngKind(
        chunks=((b"bKGD", bytes(6)), (b"tEXt", b"a\0b"), (b"pHYs", bytes(9)))
    ),
    "text behind the picture": PngKind(tail=b"garbage" * 30),
    "named .jpg": PngKind(ending=".jpg"),
    "named .tif": PngKind(ending=".tif"),
    "named .PNG": PngKind(ending=".PNG"),
    "umlauts and blanks in the name": PngKind(ending=" grün ü.png"),
}


def _animated(rng: np.random.Generator, path: Path) -> PictureFile:
    numbers = quantised(scene(rng), 8)
    frames = [Image.fromarray(np.moveaxis(n, 0, -1)) for n in (numbers, numbers[::-1])]
    out = io.BytesIO()
    frames[0].save(out, "PNG", save_all=True, append_images=frames[1:], default_image=False)
    words = ("anim", "frame", "page", "pictures")
    return PictureFile(
        save(path, ".png", out.getvalue()),
        numbers,
        ("srgb",),
        255,
        must_tell=words,
        must_name=words,
    )


def _changed(change: Callable[[bytes], bytes], words: tuple[str, ...]) -> Maker:
    """A sound PNG with something done to its bytes, which is to be refused."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        samples = np.moveaxis(quantised(scene(rng), 8), 0, -1)
        data = change(png_bytes(samples, 8, RGB, rng))
        return PictureFile(save(path, ".png", data), None, valid=False, must_name=words)

    return make


def _wrong_checksum(rng: np.random.Generator, path: Path) -> PictureFile:
    """The picture is whole, but one of its checksums isn't its own."""
    numbers = quantised(scene(rng), 8)
    data = bytearray(png_bytes(np.moveaxis(numbers, 0, -1), 8, RGB, rng))
    data[-13] ^= 0x55
    words = (*DAMAGED, "crc", "checksum")
    return PictureFile(save(path, ".png", data), None, valid=False, must_name=words)


def _huge(data: bytes) -> bytes:
    head = struct.pack(">IIBBBBB", 60000, 60000, 8, RGB, 0, 0, 0)
    return data[:8] + chunk(b"IHDR", head) + data[33:]


def _wrong_data(data: bytes) -> bytes:
    at = data.index(b"IDAT") + 60
    return data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :]


def _short_data(data: bytes) -> bytes:
    """Checksums and end in order, but the picture's data for half of the rows."""
    at = data.index(b"IDAT")
    whole = zlib.decompress(data[at + 4 : -16])
    return data[: at - 4] + chunk(b"IDAT", zlib.compress(whole[: len(whole) // 2])) + data[-12:]


def _apple(data: bytes) -> bytes:
    return data[:8] + chunk(b"CgBI", b"\x50\0\x20\2") + data[8:]


for _bits in (1, 2, 4, 8, 16):
    add_kind(f"PNG, grey of {_bits} bits", PngKind(_bits, GREY))
for _bits in (1, 2, 4, 8):
    add_kind(f"PNG, palette of {_bits} bits", PngKind(_bits, PALETTE))
for _bits in (8, 16):
    for _word, _colour in (("RGB", RGB), ("grey and alpha", GREY_ALPHA), ("RGBA", RGBA)):
        add_kind(f"PNG, {_word} of {_bits} bits", PngKind(_bits, _colour))
for _name, _kind in _KINDS.items():
    add_kind(f"PNG, {_name}", _kind)
add_kind("PNG, animated", _animated)
add_kind("PNG, wrong checksum", _wrong_checksum)
for _name, _maker in {
    "cut": _changed(lambda d: d[: len(d) // 2], DAMAGED),
    "cut behind the header": _changed(lambda d: d[:33], DAMAGED),
    "cut shortly before the end": _changed(lambda d: d[:-40], DAMAGED),
    "a byte of the data wrong": _changed(_wrong_data, (*DAMAGED, "crc", "checksum")),
    "data for half of the rows": _changed(_short_data, DAMAGED),
    "60000 x 60000 in a few bytes": _changed(
        _huge, (*DAMAGED, "60000", "large", "memory", "pixels", "bytes")
    ),
    "Apple's CgBI": _changed(_apple, ("cgbi", "apple", "iphone")),
    "no picture": _changed(lambda d: d[:8] + chunk(b"IEND", b""), (*DAMAGED, "header", "ihdr")),
}.items():
    add_kind(f"PNG, {_name}", _maker)
