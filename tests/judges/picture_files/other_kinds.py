"""Kinds of files by modern codecs, cameras' and graphics' formats, each by another library."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import imagecodecs
import numpy as np
from PIL import Image

from judges.picture_files.truth import (
    Maker,
    Numbers,
    PictureFile,
    add_kind,
    last,
    quantised,
    save,
    scene,
    smooth_scene,
)

_OPEN = ("srgb", "linear")
_ALPHA = ("alpha", "transparen")
_FRAMES = ("anim", "frame", "page", "pictures")


def _codec(
    ending: str,
    word: str,
    encode: Callable[[Numbers], Any],
    *,
    bits: int = 8,
    bands: int = 3,
    extra: int = 0,
    loss: float = 0.0,
    encodings: tuple[str, ...] = (),
) -> Maker:
    """Whole numbers through an encoder that takes (rows, columns, samples)."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        light = smooth_scene(rng, bands + extra) if loss else scene(rng, bands + extra)
        numbers = quantised(light, bits)
        return PictureFile(
            save(path, ending, bytes(encode(last(numbers)))),
            numbers[:bands],
            encodings or (("srgb",) if bits == 8 else _OPEN),
            2.0**bits - 1,
            loss=loss,
            must_name=(word,),
            must_tell=_ALPHA if extra else (),
        )

    return make


def _jp2(form: str, **options: Any) -> Callable[[Numbers], Any]:
    return lambda a: imagecodecs.jpeg2k_encode(
        a, codecformat=form, **({"reversible": True, "level": 0} | options)
    )


def _gif(colours: bool, frames: int = 1, transparent: bool = False) -> Maker:
    """Palettes, which Pillow keeps as they are."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        index = quantised(scene(rng, 1), 8)[0]
        table = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, 1)
        if colours:
            table = rng.integers(0, 256, (256, 3)).astype(np.uint8)
        pictures = []
        for turn in range(frames):
            picture = Image.fromarray(np.roll(index, 9 * turn, 1)).convert("P")
            picture.putpalette(table.tobytes())
            pictures.append(picture)
        out = io.BytesIO()
        options: dict[str, Any] = {"transparency": int(index[3, 3])} if transparent else {}
        if frames > 1:
            options |= {"save_all": True, "append_images": pictures[1:]}
        pictures[0].save(out, "GIF", optimize=False, **options)
        numbers = np.moveaxis(table[index], -1, 0)
        told = _FRAMES if frames > 1 else _ALPHA if transparent else ()
        return PictureFile(
            save(path, ".gif", out.getvalue()),
            numbers,
            ("srgb",),
            255,
            must_name=("gif", *told),
            must_tell=told,
        )

    return make


def _webp_frames(rng: np.random.Generator, path: Path) -> PictureFile:
    numbers = quantised(scene(rng), 8)
    frames = [Image.fromarray(last(n)) for n in (numbers, 255 - numbers)]
    out = io.BytesIO()
    frames[0].save(out, "WEBP", save_all=True, append_images=frames[1:], lossless=True)
    path = save(path, ".webp", out.getvalue())
    words = ("webp", *_FRAMES)
    return PictureFile(path, numbers, ("srgb",), 255, must_tell=_FRAMES, must_name=words)


def _bmp(bits: int, *, top_down: bool = False, compression: int = 0) -> Maker:
    """Windows' bitmaps: palettes, runs and bit fields, bottom row first unless told."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        table, fields, loss = b"", b"", 0.0
        if bits <= 8:
            index = quantised(scene(rng, 1), bits)[0]
            if compression == 1:
                index = index // 64 * 64
            colours = rng.integers(0, 256, (2**bits, 3)).astype(np.uint8)
            numbers = np.moveaxis(colours[index], -1, 0)
            table = np.pad(colours[:, ::-1], ((0, 0), (0, 1))).tobytes()
            lines = _index_lines(index, bits)
        elif bits == 16:
            numbers = quantised(scene(rng), 8)
            fields, loss = struct.pack("<III", 0xF800, 0x07E0, 0x001F), 0.02
            r, g, b = (numbers >> np.array([3, 2, 3])[:, None, None]).astype(np.uint16)
            lines = [line.astype("<u2").tobytes() for line in r << 11 | g << 5 | b]
        else:
            numbers = quantised(scene(rng), 8)
            pixels = np.moveaxis(numbers[::-1], 0, -1)
            pixels = np.pad(pixels, ((0, 0), (0, 0), (0, bits // 8 - 3)))
            lines = [line.tobytes() for line in pixels]
        rows, columns = numbers.shape[1:]
        if not top_down:
            lines = lines[::-1]
        if compression == 1:
            data = b"".join(_runs(line) for line in lines) + b"\0\1"
        else:
            data = b"".join(line + bytes(-len(line) % 4) for line in lines)
        begin = 54 + len(table) + len(fields)
        head = b"BM" + struct.pack("<IHHI", begin + len(data), 0, 0, begin)
        high = -rows if top_down else rows
        head += struct.pack(
            "<IiiHHIIiiII", 40, columns, high, 1, bits, compression, len(data), 2835, 2835, 0, 0
        )
        path = save(path, ".bmp", head + fields + table + data)
        return PictureFile(path, numbers, ("srgb",), 255, loss=loss, must_name=("bmp", "bitmap"))

    return make


def _index_lines(index: Numbers, bits: int) -> list[bytes]:
    ones = ((index[..., None] >> np.arange(bits - 1, -1, -1)) & 1).astype(np.uint8)
    return [line.tobytes() for line in np.packbits(ones.reshape(len(index), -1), axis=1)]


def _runs(line: bytes) -> bytes:
    out, at = b"", 0
    while at < len(line):
        count = 1
        while count < 255 and line[at + count : at + count + 1] == line[at : at + 1]:
            count += 1
        out += bytes([count, line[at]])
        at += count
    return out + b"\0\0"


def _netpbm(magic: str, top: int = 255, comment: bool = False) -> Maker:
    """PBM, PGM and PPM, as text or bytes; the highest number is the header's."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        bands = 3 if magic in ("P3", "P6") else 1
        light = scene(rng, bands)
        rows, columns = light.shape[1:]
        head = f"{magic}\n" + ("# a lab's camera\n" if comment else "") + f"{columns} {rows}\n"
        if magic in ("P1", "P4"):
            numbers = quantised(light, 1)
            ink = 1 - numbers[0]
            body = np.packbits(ink, axis=1).tobytes()
            if magic == "P1":
                body = "\n".join("".join(map(str, row)) for row in ink).encode()
            white = 1.0
        else:
            white = float(top)
            numbers = np.rint(light * top).astype(np.uint16 if top > 255 else np.uint8)
            head += f"{top}\n"
            flat = last(numbers).reshape(rows, -1)
            if magic in ("P2", "P3"):
                body = "\n".join(" ".join(map(str, row)) for row in flat).encode()
            else:
                body = flat.astype(">u2" if top > 255 else np.uint8).tobytes()
        ending = {"P1": ".pbm", "P4": ".pbm", "P3": ".ppm", "P6": ".ppm"}.get(magic, ".pgm")
        words = ("pbm", "pgm", "ppm", "netpbm", "portable", str(top))
        encodings = ("srgb",) if top == 255 and white != 1 else _OPEN
        path = save(path, ending, head.encode() + body)
        return PictureFile(path, numbers, encodings, white, must_name=words)

    return make


def _pam(kind: str, top: int = 255) -> Maker:
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        depth = {"GRAYSCALE": 1, "RGB": 3, "RGB_ALPHA": 4, "GRAYSCALE_ALPHA": 2}[kind]
        numbers = np.rint(scene(rng, depth) * top).astype(np.uint16 if top > 255 else np.uint8)
        bands = 3 if kind.startswith("RGB") else 1
        rows, columns = numbers.shape[1:]
        head = f"P7\nWIDTH {columns}\nHEIGHT {rows}\nDEPTH {depth}\nMAXVAL {top}\n"
        head += f"TUPLTYPE {kind}\nENDHDR\n"
        body = last(numbers).astype(">u2" if top > 255 else np.uint8).tobytes()
        path = save(path, ".pam", head.encode() + body)
        told = _ALPHA if depth > bands else ()
        encodings = ("srgb",) if top == 255 else _OPEN
        return PictureFile(
            path,
            numbers[:bands],
            encodings,
            top,
            must_name=("pam", "netpbm", "p7", *told),
            must_tell=told,
        )

    return make


def _pfm(bands: int, order: str) -> Maker:
    """Bottom row first; the sign of the scale tells the byte order."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = (scene(rng, bands) * 40).astype(np.float32)
        rows, columns = numbers.shape[1:]
        head = (
            f"{'PF' if bands == 3 else 'Pf'}\n{columns} {rows}\n{'-' if order == '<' else ''}1.0\n"
        )
        body = last(numbers[:, ::-1]).astype(order + "f4").tobytes()
        return PictureFile(save(path, ".pfm", head.encode() + body), numbers, must_name=("pfm",))

    return make


def _radiance(by_opencv: bool) -> Maker:
    """Shared exponents of 8 bits: held against what the format can hold."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        light = (scene(rng) * 40).astype(np.float32)
        if by_opencv:
            data = cv2.imencode(".hdr", last(light[::-1]))[1].tobytes()
        else:
            data = bytes(imagecodecs.rgbe_encode(last(light)))
        words = ("radiance", "hdr")
        return PictureFile(save(path, ".hdr", data), light, white=40.0, loss=0.008, must_name=words)

    return make


def _exr(half: bool, bands: int, compression: str) -> Maker:
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        import OpenEXR

        numbers = (scene(rng, bands) * 40).astype(np.float16 if half else np.float32)
        header = {
            "compression": getattr(OpenEXR, compression),
            "type": OpenEXR.scanlineimage,
        }
        names = "RGB" if bands == 3 else "Y"
        channels = {n: np.ascontiguousarray(b) for n, b in zip(names, numbers, strict=True)}
        path = path.with_name(path.name + ".exr")
        with OpenEXR.File(header, channels) as file:
            file.write(str(path))
        return PictureFile(path, numbers, must_name=("openexr", "exr"))

    return make


def _fits(kind: str) -> Maker:
    """FITS 4.0: a primary array in big endian, unsigned ones by BZERO, cards of 80 letters."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        light = scene(rng, 3 if kind == "cube" else 1)
        cards: list[tuple[str, Any]] = []
        white: float | None = None
        if kind in ("float", "cube", "extension"):
            numbers = (light * 900).astype(np.float32)
            bits, stored = -32, numbers.astype(">f4")
        elif kind == "unsigned":
            numbers, white = quantised(light, 16), 65535.0
            bits, stored = 16, (numbers.astype(int) - 32768).astype(">i2")
            cards = [("BZERO", 32768.0), ("BSCALE", 1.0)]
        elif kind == "scaled":
            whole = quantised(light, 12)
            numbers = whole * 0.25 - 7.0
            bits, stored = 16, whole.astype(">i2")
            cards = [("BSCALE", 0.25), ("BZERO", -7.0)]
        elif kind == "doubles":
            numbers, bits = light, -64
            stored = numbers.astype(">f8")
        else:
            numbers, white, bits = quantised(light, 8), 255.0, 8
            stored = numbers
        shape = numbers.shape[1:] if kind != "cube" else numbers.shape
        data = _fits_part(True, bits, shape, cards, stored.tobytes())
        if kind == "extension":
            data = _fits_part(True, 8, (), [("EXTEND", True)], b"")
            data += _fits_part(False, bits, shape, cards, stored.tobytes())
        words = ("fits",)
        # The first row is the picture's lowest on a sky chart, and the first in an array.
        turned = numbers[:, ::-1]
        return PictureFile(
            save(path, ".fits", data),
            numbers,
            ("linear",),
            white,
            also=(turned,),
            must_name=words,
        )

    return make


def _fits_part(
    first: bool, bits: int, shape: tuple[int, ...], cards: list[tuple[str, Any]], data: bytes
) -> bytes:
    whole: list[tuple[str, Any]] = [("SIMPLE", True) if first else ("XTENSION", "'IMAGE   '")]
    whole += [("BITPIX", bits), ("NAXIS", len(shape))]
    whole += [(f"NAXIS{i + 1}", n) for i, n in enumerate(shape[::-1])]
    whole += [] if first else [("PCOUNT", 0), ("GCOUNT", 1)]
    text = ""
    for key, value in [*whole, *cards]:
        said = ("T" if value else "F") if isinstance(value, bool) else str(value)
        text += f"{key:8}= {said:>20}".ljust(80)
    text += "END".ljust(80)
    head = text.ljust(-(-len(text) // 2880) * 2880).encode()
    return head + data + bytes(-len(data) % 2880)


def _psd(bits: int) -> Maker:
    """Photoshop's merged picture, planes one after the other."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = quantised(scene(rng), bits)
        rows, columns = numbers.shape[1:]
        head = b"8BPS" + struct.pack(">H6xHIIHH", 1, 3, rows, columns, bits, 3)
        data = head + bytes(12) + b"\0\0" + numbers.astype(f">u{bits // 8}").tobytes()
        words = ("psd", "photoshop")
        encodings = ("srgb",) if bits == 8 else _OPEN
        return PictureFile(
            save(path, ".psd", data), numbers, encodings, 2.0**bits - 1, must_name=words
        )

    return make


def _sun(rng: np.random.Generator, path: Path) -> PictureFile:
    """Sun raster of 24 bits, blue first, rows of an even number of bytes."""
    numbers = quantised(scene(rng), 8)
    rows, columns = numbers.shape[1:]
    lines = [line.tobytes() for line in last(numbers[::-1])]
    body = b"".join(line + bytes(len(line) % 2) for line in lines)
    head = struct.pack(">8I", 0x59A66A95, columns, rows, 24, len(body), 1, 0, 0)
    path = save(path, ".ras", head + body)
    return PictureFile(path, numbers, ("srgb",), 255, must_name=("sun", "raster"))


def _tga(*, top_down: bool, runs: bool, ending: str = ".tga") -> Maker:
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = quantised(scene(rng), 8)
        rows, columns = numbers.shape[1:]
        lines = last(numbers[::-1])
        lines = lines if top_down else lines[::-1]
        body = b""
        for line in lines:
            for at in range(0, columns, 100):
                piece = line[at : at + 100]
                body += (bytes([len(piece) - 1]) if runs else b"") + piece.tobytes()
        head = struct.pack(
            "<BBBHHBHHHHBB",
            0,
            0,
            10 if runs else 2,
            0,
            0,
            0,
            0,
            0,
            columns,
            rows,
            24,
            32 * top_down,
        )
        words = ("tga", "targa")
        return PictureFile(
            save(path, ending, head + body), numbers, ("srgb",), 255, must_name=words
        )

    return make


_KINDS: dict[str, Maker] = {
    "JPEG 2000, jp2": _codec(".jp2", "jpeg 2000", _jp2("jp2")),
    "JPEG 2000, code stream": _codec(".j2k", "jpeg 2000", _jp2("j2k")),
    "JPEG 2000 of 12 bits, grey": _codec(
        ".jp2", "jpeg 2000", _jp2("jp2", bitspersample=12), bits=12, bands=1
    ),
    "JPEG 2000 of 16 bits": _codec(".jp2", "jpeg 2000", _jp2("jp2"), bits=16),
    "JPEG 2000, lossy": _codec(
        ".jp2", "jpeg 2000", _jp2("jp2", reversible=False, level=45), loss=0.02
    ),
    "JPEG 2000 of high throughput": _codec(
        ".jph", "jpeg 2000", lambda a: imagecodecs.htj2k_encode(a, reversible=True)
    ),
    "JPEG XL": _codec(".jxl", "jpeg xl", lambda a: imagecodecs.jpegxl_encode(a, lossless=True)),
    "JPEG XL of 16 bits": _codec(
        ".jxl", "jpeg xl", lambda a: imagecodecs.jpegxl_encode(a, lossless=True), bits=16
    ),
    "JPEG XL, lossy": _codec(
        ".jxl", "jpeg xl", lambda a: imagecodecs.jpegxl_encode(a, level=90), loss=0.02
    ),
    "AVIF": _codec(".avif", "avif", lambda a: imagecodecs.avif_encode(a, level=95), loss=0.02),
    "AVIF of 10 bits": _codec(
        ".avif",
        "avif",
        lambda a: imagecodecs.avif_encode(a, level=95, bitspersample=10),
        bits=10,
        loss=0.02,
    ),
    "AVIF of 12 bits": _codec(
        ".avif",
        "avif",
        lambda a: imagecodecs.avif_encode(a, level=95, bitspersample=12),
        bits=12,
        loss=0.02,
    ),
    "AVIF by Pillow": _codec(".avif", "avif", lambda a: _saved(a, "AVIF", quality=95), loss=0.02),
    "WebP, lossless": _codec(".webp", "webp", lambda a: imagecodecs.webp_encode(a, lossless=True)),
    "WebP, lossy": _codec(".webp", "webp", lambda a: _saved(a, "WEBP", quality=90), loss=0.03),
    "WebP with alpha": _codec(
        ".webp", "webp", lambda a: _saved(a, "WEBP", lossless=True, exact=True), extra=1
    ),
    "WebP, animated": _webp_frames,
    "JPEG XR": _codec(".jxr", "jpeg xr", lambda a: imagecodecs.jpegxr_encode(a, level=1.0)),
    "JPEG XR of 16 bits": _codec(
        ".jxr", "jpeg xr", lambda a: imagecodecs.jpegxr_encode(a, level=1.0), bits=16, bands=1
    ),
    "JPEG-LS": _codec(".jls", "jpeg-ls", imagecodecs.jpegls_encode),
    "JPEG-LS of 16 bits": _codec(".jls", "jpeg-ls", imagecodecs.jpegls_encode, bits=16, bands=1),
    "QOI": _codec(".qoi", "qoi", imagecodecs.qoi_encode),
    "GIF, grey": _gif(False),
    "GIF": _gif(True),
    "GIF, animated": _gif(True, 3),
    "GIF, transparent": _gif(True, transparent=True),
    "BMP of 1 bit": _bmp(1),
    "BMP of 4 bits": _bmp(4),
    "BMP of 8 bits": _bmp(8),
    "BMP of 16 bits, fields": _bmp(16, compression=3),
    "BMP of 24 bits": _bmp(24),
    "BMP of 24 bits, top row first": _bmp(24, top_down=True),
    "BMP of 32 bits": _bmp(32),
    "BMP, runs": _bmp(8, compression=1),
    "PBM, text": _netpbm("P1"),
    "PBM": _netpbm("P4"),
    "PGM, text": _netpbm("P2", comment=True),
    "PGM": _netpbm("P5"),
    "PGM up to 100": _netpbm("P5", 100),
    "PGM up to 1023": _netpbm("P5", 1023),
    "PGM, text up to 4095": _netpbm("P2", 4095),
    "PGM of 16 bits": _netpbm("P5", 65535),
    "PPM, text": _netpbm("P3"),
    "PPM": _netpbm("P6", comment=True),
    "PPM up to 1023": _netpbm("P6", 1023),
    "PPM of 16 bits": _netpbm("P6", 65535),
    "PAM, grey": _pam("GRAYSCALE"),
    "PAM, RGB": _pam("RGB"),
    "PAM, RGB and alpha": _pam("RGB_ALPHA"),
    "PAM, grey of 16 bits and alpha": _pam("GRAYSCALE_ALPHA", 65535),
    "PFM, grey": _pfm(1, "<"),
    "PFM, big endian": _pfm(3, ">"),
    "TGA": _tga(top_down=False, runs=False),
    "TGA, runs, top row first": _tga(top_down=True, runs=True),
    "Sun raster": _sun,
    "Radiance HDR": _radiance(False),
    "Radiance HDR by OpenCV": _radiance(True),
    "OpenEXR, half": _exr(True, 3, "ZIP_COMPRESSION"),
    "OpenEXR, float": _exr(False, 3, "PIZ_COMPRESSION"),
    "OpenEXR, grey": _exr(False, 1, "NO_COMPRESSION"),
    "FITS of 8 bits": _fits("bytes"),
    "FITS of 16 bits, unsigned": _fits("unsigned"),
    "FITS, scaled": _fits("scaled"),
    "FITS, float": _fits("float"),
    "FITS, doubles": _fits("doubles"),
    "FITS, three planes": _fits("cube"),
    "FITS, picture in an extension": _fits("extension"),
    "PSD": _psd(8),
    "PSD of 16 bits": _psd(16),
    "DDS": _codec(".dds", "dds", lambda a: _saved(a, "DDS")),
    "PCX": _codec(".pcx", "pcx", lambda a: _saved(a, "PCX")),
    "SGI": _codec(".sgi", "sgi", lambda a: _saved(a, "SGI")),
    "ICO": _codec(".ico", "ico", lambda a: _saved(a, "ICO", sizes=[a.shape[1::-1]])),
}


def _saved(samples: Numbers, form: str, **options: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(samples).save(out, form, **options)
    return out.getvalue()


for _name, _maker in _KINDS.items():
    add_kind(_name, _maker)
