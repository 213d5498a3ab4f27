"""Mixtures drawn at random: what no list of kinds foresees. Each seed is another file."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from judges.picture_files import png_kinds as p
from judges.picture_files import tiff_bytes as t
from judges.picture_files.icc import grey_profile, icc_profile
from judges.picture_files.tiff_bytes import FLOAT, SIGNED, UNSIGNED, Layout
from judges.picture_files.tiff_kinds import ASSOCIATED, UNASSOCIATED, UNSPECIFIED, TiffKind
from judges.picture_files.truth import PictureFile, add_kind

_BITS = {
    UNSIGNED: (1, 2, 4, 8, 8, 10, 12, 14, 16, 16, 16, 32),
    SIGNED: (8, 16, 32),
    FLOAT: (16, 32, 32, 64),
}
_BYTES = (t.NONE, t.NONE, t.LZW, t.DEFLATE, t.PACKBITS, t.ZSTD, t.LZMA)


def _pick(rng: np.random.Generator, *choices):
    return choices[int(rng.integers(len(choices)))]


def tiff_mixture(rng: np.random.Generator) -> TiffKind:
    """Layout, byte order, alpha, compression, orientation and profile by chance."""
    form = _pick(rng, UNSIGNED, UNSIGNED, UNSIGNED, UNSIGNED, FLOAT, SIGNED)
    bits, bands = _pick(rng, *_BITS[form]), _pick(rng, 1, 3)
    extra = _pick(rng, (), (), (), (UNASSOCIATED,), (ASSOCIATED,), (UNSPECIFIED, UNSPECIFIED))
    inverted = bands == 1 and form == UNSIGNED and rng.random() < 0.25
    if extra == (ASSOCIATED,) and (inverted or form == SIGNED or bits < 8):
        # What is multiplied there, no specification says.
        extra = (UNASSOCIATED,)
    separate = bool(rng.random() < 0.4) and bands + len(extra) > 1
    compression = _compression(rng, form, bits, bands if not separate else 1, len(extra))
    whole_bytes = bits in (8, 16, 32, 64) and compression in (t.LZW, t.DEFLATE, t.ZSTD, t.LZMA)
    predictor = _pick(rng, 1, 3 if form == FLOAT else 2) if whole_bytes else 1
    shape: dict[str, object] = _pick(
        rng, {}, {"strip": int(rng.integers(1, 20))}, {"tile": _pick(rng, (16, 16), (32, 48))}
    )
    # Of LERC in big endian, libtiff packs swapped numbers, and the specification says nothing.
    order = "<" if compression == t.LERC else _pick(rng, "<", ">")
    tells = bits in (8, 16) and form == UNSIGNED and rng.random() < 0.2
    linear = bool(rng.random() < 0.5)
    profile = icc_profile if bands == 3 else grey_profile
    return TiffKind(
        Layout(
            bits,
            form,
            0 if inverted else 1,
            separate,
            compression=compression,
            predictor=predictor,
            extra=extra,
            **shape,
        ),
        bands,
        order,
        bool(rng.random() < 0.2),
        encodings=(("linear",) if linear else ("srgb",)) if tells else (),
        icc=profile(1 if linear else "srgb") if tells else b"",
        orientation=_pick(rng, 1, 1, 1, *range(2, 9)),
    )


def _compression(rng: np.random.Generator, form: int, bits: int, samples: int, extra: int) -> int:
    """One that can hold such samples."""
    choices = list(_BYTES)
    if form == UNSIGNED and bits in (8, 16) and not extra:
        choices += [t.JPEG_2000, t.JPEG_XL, t.PNG, t.LERC]
        choices += [t.WEBP] if bits == 8 and samples == 3 else []
    return _pick(rng, *choices)


def png_mixture(rng: np.random.Generator) -> p.PngKind:
    """Colour type, bits, interlace, transparency, transfer and orientation by chance."""
    colour = _pick(rng, p.GREY, p.RGB, p.PALETTE, p.GREY_ALPHA, p.RGBA)
    bits = _pick(rng, 8, 16)
    if colour in (p.GREY, p.PALETTE):
        bits = _pick(rng, 1, 2, 4, 8) if colour == p.PALETTE else _pick(rng, 1, 2, 4, 8, 16)
    chunks: list[p.Chunk] = []
    encodings: tuple[str, ...] = ()
    grey = colour in (p.GREY, p.GREY_ALPHA)
    way = _pick(rng, "none", "none", "gama", "srgb", "icc", "cicp")
    if way == "gama":
        chunks.append((b"gAMA", struct.pack(">I", 100000)))
        encodings = ("linear",)
    elif way == "srgb":
        chunks.append((b"sRGB", b"\0"))
        encodings = ("srgb",)
    elif way == "icc":
        encodings = _pick(rng, ("linear",), ("srgb",))
        profile = (grey_profile if grey else icc_profile)(1 if encodings == ("linear",) else "srgb")
        chunks.append((b"iCCP", b"p\0\0" + zlib.compress(profile)))
    elif way == "cicp":
        encodings = _pick(rng, ("linear",), ("srgb",))
        chunks.append((b"cICP", bytes([1, 8 if encodings == ("linear",) else 13, 0, 1])))
    orientation = _pick(rng, 1, 1, *range(2, 9))
    if orientation != 1:
        chunks.append((b"eXIf", p.exif(orientation)))
    if rng.random() < 0.3:
        chunks += {p.GREY: [(b"tRNS", b"\0\1")], p.RGB: [(b"tRNS", bytes(6))]}.get(colour, [])
        chunks += [(b"tRNS", b"\x80")] if colour == p.PALETTE else []
    return p.PngKind(
        bits,
        colour,
        bool(rng.random() < 0.4),
        tuple(chunks),
        encodings,
        pieces=_pick(rng, 1, 5),
        orientation=orientation,
    )


def _tiff(rng: np.random.Generator, path: Path) -> PictureFile:
    return tiff_mixture(rng)(rng, path)


def _png(rng: np.random.Generator, path: Path) -> PictureFile:
    return png_mixture(rng)(rng, path)


add_kind("TIFF, mixture", _tiff)
add_kind("PNG, mixture", _png)
for _name, _kind in {
    "separate planes, LZW, predictor, big endian, alpha": TiffKind(
        Layout(16, separate=True, compression=t.LZW, predictor=2, extra=(UNASSOCIATED,), strip=6),
        order=">",
    ),
    "WhiteIsZero, tiles, zstd": TiffKind(
        Layout(16, photometric=0, tile=(16, 32), compression=t.ZSTD), 1
    ),
    "WhiteIsZero, alpha, deflate, BigTIFF": TiffKind(
        Layout(16, photometric=0, compression=t.DEFLATE, extra=(UNASSOCIATED,)), 1, big=True
    ),
    "12 bits, separate planes, deflate, big endian": TiffKind(
        Layout(12, separate=True, compression=t.DEFLATE, strip=5), order=">"
    ),
    "float, predictor 3, separate planes, tiles, big endian": TiffKind(
        Layout(32, FLOAT, separate=True, tile=(16, 16), compression=t.DEFLATE, predictor=3),
        order=">",
    ),
    "JPEG 2000 inside, separate planes of 16 bits, tiles": TiffKind(
        Layout(16, separate=True, tile=(32, 32), compression=t.JPEG_2000)
    ),
    "PNG inside, tiles, orientation": TiffKind(
        Layout(16, tile=(32, 32), compression=t.PNG), orientation=7
    ),
    "ICC linear, orientation, alpha, LZW": TiffKind(
        Layout(8, compression=t.LZW, extra=(UNASSOCIATED,)),
        icc=icc_profile(1),
        orientation=6,
        encodings=("linear",),
    ),
    "10 bits, reverse fill order": TiffKind(Layout(10, reverse_bits=True), 1, must_name=("fill",)),
    "signed, predictor, zstd, alpha": TiffKind(
        Layout(16, SIGNED, compression=t.ZSTD, predictor=2, extra=(UNASSOCIATED,)), 1
    ),
    "doubles, separate planes, alpha": TiffKind(
        Layout(64, FLOAT, separate=True, extra=(UNASSOCIATED,))
    ),
}.items():
    add_kind(f"TIFF, {_name}", _kind)
for _name, _png_kind in {
    "interlaced, ICC linear, orientation": p.PngKind(
        16,
        p.RGBA,
        True,
        ((b"iCCP", b"p\0\0" + zlib.compress(icc_profile(1))), (b"eXIf", p.exif(8))),
        ("linear",),
        orientation=8,
    ),
    "palette of 2 bits, interlaced, transparent, linear": p.PngKind(
        2,
        p.PALETTE,
        True,
        ((b"gAMA", struct.pack(">I", 100000)), (b"tRNS", b"\x30\x60")),
        ("linear",),
    ),
    "grey of 4 bits, transparent, ICC linear": p.PngKind(
        4,
        p.GREY,
        chunks=(
            (b"iCCP", b"p\0\0" + zlib.compress(grey_profile(1))),
            (b"tRNS", b"\0\3"),
        ),
        encodings=("linear",),
    ),
}.items():
    add_kind(f"PNG, {_name}", _png_kind)
