"""Kinds of TIFF files of other colours than RGB: palettes, YCbCr, CIELab, CMYK, JPEG inside."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import imagecodecs
import numpy as np
from PIL import Image

from judges.picture_files import tiff_bytes as t
from judges.picture_files.tiff_bytes import Layout, Page, tiff_file, tiff_page
from judges.picture_files.truth import (
    Numbers,
    PictureFile,
    add_kind,
    decoded,
    last,
    quantised,
    save,
    scene,
    size,
    smooth_scene,
)

_JPEG_LOSS = 0.025
"""Rms share of white that JPEG of quality 95 may take from a smooth scene, chroma halved."""


def _palette(bits: int, eight: bool, order: str = "<", **layout: object):
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        count = 2**bits
        table = rng.integers(0, 65536, (3, count)).astype(np.uint16)
        if eight:
            table = table // 257 * 257
        index = quantised(scene(rng, 1), bits)[0]
        tags = {320: (3, table.ravel().tolist())}
        page = tiff_page(index, Layout(bits, photometric=3, tags=tags, **layout), order)
        colours = table[:, index]
        path = save(path, ".tif", tiff_file([page], order))
        also = (colours // 257,) if eight else ()
        return PictureFile(
            path,
            colours,
            ("srgb", "linear"),
            65535,
            also=also,
            must_name=("palette", "colour map"),
        )

    return make


def _ycbcr(rgb: Numbers) -> Numbers:
    """(3, ...) of 8 bits to TIFF's default: BT.601 over all 256 levels."""
    r, g, b = rgb.astype(float)
    y = 0.299 * r + 0.587 * g + 0.114 * b
    cb, cr = (b - y) / 1.772 + 128, (r - y) / 1.402 + 128
    return np.clip(np.rint(np.stack([y, cb, cr])), 0, 255).astype(np.uint8)


def _uncompressed_ycbcr(subsampling: tuple[int, int], compression: int = t.NONE):
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        rgb = quantised(smooth_scene(rng), 8)
        levels = [(0, 1), (255, 1), (128, 1), (255, 1), (128, 1), (255, 1)]
        layout = Layout(
            photometric=6, subsampling=subsampling, compression=compression, tags={532: (5, levels)}
        )
        path = save(path, ".tif", tiff_file([tiff_page(last(_ycbcr(rgb)), layout)]))
        return PictureFile(path, rgb, ("srgb",), 255, loss=0.02, must_name=("ycbcr",))

    return make


def _jpeg_inside(photometric: int, subsampling: str, tile: bool, tables: bool):
    """Strips or tiles of JPEG, with tables of their own or in a tag."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        bands = 1 if photometric == 1 else 3
        rgb = quantised(smooth_scene(rng, bands), 8)
        layout = Layout(
            photometric=photometric,
            tile=(32, 32) if tile else None,
            strip=None if tile else 16,
            subsampling=(2, 2) if subsampling == "420" else (1, 1),
        )
        pieces = tiff_page(last(rgb), layout)
        shapes = _piece_shapes(rgb.shape[1:], layout)
        raw = [
            np.frombuffer(s, np.uint8).reshape(*shape, bands)
            for s, shape in zip(_plain_segments(last(rgb), layout), shapes, strict=True)
        ]
        colour = {1: None, 2: "rgb", 6: "ycbcr"}[photometric]
        segments = [
            _jpeg(piece[..., 0] if bands == 1 else piece, colour, subsampling) for piece in raw
        ]
        tags = dict(pieces.tags) | {259: (3, [t.JPEG])}
        if tables:
            common, _ = _split_jpeg(segments[0])
            tags[347] = (7, common)
            segments = [_split_jpeg(segment)[1] for segment in segments]
        path = save(path, ".tif", tiff_file([Page(tags, segments, tile)]))
        return PictureFile(path, rgb, ("srgb",), 255, loss=_JPEG_LOSS, must_name=("jpeg",))

    return make


def _plain_segments(samples: Numbers, layout: Layout) -> list[bytes]:
    """The pieces of RGB without the grouping of subsampled colours."""
    return tiff_page(samples, Layout(strip=layout.strip, tile=layout.tile)).segments


def _piece_shapes(shape: tuple[int, ...], layout: Layout) -> list[tuple[int, int]]:
    rows, columns = shape
    if layout.tile:
        count = -(-rows // layout.tile[0]) * -(-columns // layout.tile[1])
        return [layout.tile] * count
    step = layout.strip or rows
    return [(min(step, rows - i), columns) for i in range(0, rows, step)]


def _jpeg(piece: Numbers, colour: str | None, subsampling: str) -> bytes:
    """A stream without markers that would say another colour than the TIFF's tags."""
    piece = np.ascontiguousarray(piece)
    if colour is None:
        return imagecodecs.jpeg8_encode(piece, level=95)
    return imagecodecs.jpeg8_encode(
        piece,
        level=95,
        colorspace="rgb",
        outcolorspace=colour,
        subsampling=subsampling if colour == "ycbcr" else "444",
    )


def _split_jpeg(stream: bytes) -> tuple[bytes, bytes]:
    """The tables (DQT, DHT) as a stream of their own, and the stream without them."""
    tables, rest, at = b"", stream[:2], 2
    while stream[at + 1] != 0xDA:
        (length,) = struct.unpack_from(">H", stream, at + 2)
        marker = stream[at : at + 2 + length]
        if stream[at + 1] in (0xDB, 0xC4):
            tables += marker
        else:
            rest += marker
        at += 2 + length
    return b"\xff\xd8" + tables + b"\xff\xd9", rest + stream[at:]


def _lab(bits: int, photometric: int = 8):
    """CIELab under D50 of linear light; skimage does the arithmetic for D65 after Bradford."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        rows, columns = size(rng)
        lightness = 20 + 60 * scene(rng, 1, (rows, columns))[0]
        a, b = 24 * (scene(rng, 2, (rows, columns)) - 0.5)
        lab = np.stack([lightness, a, b], -1)
        scale = {8: 255 / 100, 16: 65535 / 100}[bits]
        step = {8: 1, 16: 256}[bits]
        stored = np.stack([lab[..., 0] * scale, lab[..., 1] * step, lab[..., 2] * step], -1)
        dtype = f"i{bits // 8}"
        whole = np.rint(stored).astype(np.int64).astype(f"u{bits // 8}")
        if photometric == 9:
            whole = whole + np.array([0, 128 * step, 128 * step], whole.dtype)
        page = tiff_page(whole, Layout(bits, photometric=photometric))
        path = save(path, ".tif", tiff_file([page]))
        assert np.dtype(dtype).itemsize == bits // 8
        return PictureFile(
            path,
            None,
            (),
            light=np.clip(lab_light(lab), 0, 1),
            loss=0.02,
            must_name=("lab", "l*a*b*"),
            must_tell=("lab",),
        )

    return make


def lab_light(lab: Numbers) -> Numbers:
    """Linear light of sRGB's primaries, (3, rows, columns), of CIELab under D50."""
    f = (lab[..., 0] + 16) / 116
    f = np.stack([f + lab[..., 1] / 500, f, f - lab[..., 2] / 200])
    xyz = np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29))
    xyz *= np.array([0.9642, 1.0, 0.8249])[:, None, None]
    # XYZ under D50 to linear sRGB, Bradford's adaptation in it.
    matrix = [
        [3.1338561, -1.6168667, -0.4906146],
        [-0.9787684, 1.9161415, 0.0334540],
        [0.0719453, -0.2289914, 1.4052427],
    ]
    return np.tensordot(np.array(matrix), xyz, 1)


def _cmyk(bits: int, separate: bool = False, compression: int = t.NONE):
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        light = scene(rng, 4)
        light[3] *= 0.3
        inks = quantised(light, bits)
        layout = Layout(bits, photometric=5, separate=separate, compression=compression)
        page = tiff_page(last(inks), layout)
        path = save(path, ".tif", tiff_file([page]))
        return PictureFile(
            path,
            None,
            (),
            light=naive_rgb(inks / (2.0**bits - 1)),
            loss=0.02,
            must_name=("cmyk",),
            must_tell=("cmyk", "inks"),
        )

    return make


def naive_rgb(inks: Numbers) -> Numbers:
    """Light where each ink, and black, takes its share of sRGB values."""
    return decoded((1 - inks[:3]) * (1 - inks[3:]), "srgb")


def _by_pillow(compression: str, mode: str = "1"):
    """What only libtiff writes here: CCITT's fax codes."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        bits = quantised(scene(rng, 1), 1)
        out = io.BytesIO()
        Image.fromarray(bits[0] * np.uint8(255)).convert(mode, dither=0).save(
            out, "TIFF", compression=compression
        )
        path = save(path, ".tif", out.getvalue())
        words = ("ccitt", "fax", "1-bit", "1 bit")
        return PictureFile(path, bits, ("srgb", "linear"), 1, must_name=words)

    return make


def _old_jpeg(rng: np.random.Generator, path: Path) -> PictureFile:
    """Compression 6 of TIFF 6.0, the whole stream in JPEGInterchangeFormat."""
    rgb = quantised(smooth_scene(rng), 8)
    stream = imagecodecs.jpeg8_encode(np.ascontiguousarray(last(rgb)), level=95, subsampling="444")
    page = tiff_page(last(rgb), Layout(photometric=6))
    head = 8
    tags = dict(page.tags) | {
        259: (3, [6]),
        512: (3, [1]),
        513: (4, [head]),
        514: (4, [len(stream)]),
    }
    path = save(path, ".tif", tiff_file([Page(tags, [stream], False)]))
    return PictureFile(path, rgb, ("srgb",), 255, loss=_JPEG_LOSS, must_name=("jpeg",))


def _logluv(rng: np.random.Generator, path: Path) -> PictureFile:
    """LogL of 16 bits, uncompressed by SGILog's tag: luminance as a logarithm."""
    light = scene(rng, 1)
    stored = np.rint(256 * (np.log2(light) + 64) - 0.5).astype(np.uint16)
    back = np.exp2((stored + 0.5) / 256 - 64)
    data = _sgilog(stored[0])
    page = tiff_page(stored[0], Layout(16, photometric=32844))
    tags = dict(page.tags) | {259: (3, [34676])}
    path = save(path, ".tif", tiff_file([Page(tags, [data], False)]))
    return PictureFile(path, None, (), light=back, loss=0.01, must_name=("logl", "sgilog"))


def _sgilog(levels: Numbers) -> bytes:
    """High bytes, then low ones, of each row, in literal runs."""
    out = b""
    for row in levels:
        for octets in (row >> 8, row & 255):
            for at in range(0, len(octets), 127):
                piece = octets[at : at + 127].astype(np.uint8)
                out += bytes([len(piece)]) + piece.tobytes()
    return out


for _name, _maker in {
    "palette of 8 bits": _palette(8, True),
    "palette of 4 bits": _palette(4, True),
    "palette of 1 bit": _palette(1, True),
    "palette of 8 bits, colours of 16": _palette(8, False),
    "palette of 16 bits": _palette(16, False),
    "palette, LZW, tiles, big endian": _palette(8, True, ">", compression=t.LZW, tile=(16, 16)),
    "YCbCr": _uncompressed_ycbcr((1, 1)),
    "YCbCr 2 x 2": _uncompressed_ycbcr((2, 2)),
    "YCbCr 2 x 1, LZW": _uncompressed_ycbcr((2, 1), t.LZW),
    "JPEG inside, grey": _jpeg_inside(1, "444", False, False),
    "JPEG inside, RGB": _jpeg_inside(2, "444", False, False),
    "JPEG inside, YCbCr 4:4:4": _jpeg_inside(6, "444", False, False),
    "JPEG inside, YCbCr 4:2:0": _jpeg_inside(6, "420", False, False),
    "JPEG inside, tables in a tag": _jpeg_inside(6, "420", False, True),
    "JPEG inside, tiles, tables in a tag": _jpeg_inside(6, "420", True, True),
    "JPEG inside, RGB tiles, tables in a tag": _jpeg_inside(2, "444", True, True),
    "JPEG inside by TIFF 6.0": _old_jpeg,
    "CIELab": _lab(8),
    "CIELab of 16 bits": _lab(16),
    "ICCLab": _lab(8, 9),
    "CMYK": _cmyk(8),
    "CMYK of 16 bits": _cmyk(16),
    "CMYK, separate planes": _cmyk(8, True),
    "CMYK, LZW, 16 bits": _cmyk(16, compression=t.LZW),
    "CCITT G3": _by_pillow("group3"),
    "CCITT G4": _by_pillow("group4"),
    "CCITT RLE": _by_pillow("tiff_ccitt"),
    "LogL": _logluv,
}.items():
    add_kind(f"TIFF, {_name}", _maker)
