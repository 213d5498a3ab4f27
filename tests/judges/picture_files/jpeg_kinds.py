"""Kinds of JPEG files: colours, processes, markers, two pictures in one, and damaged ones."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
from PIL import Image

from judges.picture_files.arithmetic_jpeg import arithmetic_jpeg
from judges.picture_files.icc import grey_profile, icc_profile
from judges.picture_files.tiff_colour_kinds import naive_rgb
from judges.picture_files.tiff_page_kinds import DAMAGED
from judges.picture_files.truth import (
    Maker,
    Numbers,
    PictureFile,
    add_kind,
    last,
    quantised,
    save,
    smooth_scene,
)

_LOSS = 0.025
"""Rms share of white that quality 95 may take from a smooth scene, chroma halved."""


def _by_pillow(
    bands: int = 3,
    *,
    subsampling: int = 0,
    orientation: int = 1,
    icc: bytes = b"",
    encodings: tuple[str, ...] = ("srgb",),
    power: float | None = None,
    ending: str = ".jpg",
    exposure: bool = False,
    thumbnail: bool = False,
    tail: bytes = b"",
    **options: Any,
) -> Maker:
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = quantised(smooth_scene(rng, bands), 8)
        out = io.BytesIO()
        marks, told = _exif(orientation, exposure)
        if icc:
            options["icc_profile"] = icc
        Image.fromarray(last(numbers)).save(
            out, "JPEG", quality=95, subsampling=subsampling, exif=marks, **options
        )
        data = out.getvalue()
        if thumbnail:
            data = _with_thumbnail(data, last(numbers)[::4, ::4])
        light = (numbers / 255.0) ** power if power else None
        return PictureFile(
            save(path, ending, data + tail),
            numbers,
            () if power else encodings,
            255,
            light=light,
            loss=_LOSS,
            orientation=orientation,
            exposure=told,
            must_name=("icc", "profile") if icc else (),
        )

    return make


def _exif(orientation: int, exposure: bool) -> tuple[Image.Exif, dict[str, float]]:
    marks = Image.Exif()
    if orientation != 1:
        marks[274] = orientation
    if not exposure:
        return marks, {}
    marks[271], marks[272] = "Maker", "Model"
    inner = marks.get_ifd(34665)
    inner[33434], inner[33437], inner[34855] = 1 / 250, 5.6, 400
    return marks, {"exposure_time": 1 / 250, "f_number": 5.6, "iso": 400}


def _with_thumbnail(data: bytes, small: Numbers) -> bytes:
    """Exif whose second directory holds a JPEG of its own, as every camera writes it."""
    out = io.BytesIO()
    Image.fromarray(255 - np.ascontiguousarray(small)).save(out, "JPEG")
    picture = out.getvalue()
    first = struct.pack("<H HHIHH I", 1, 274, 3, 1, 1, 0, 26)
    second = struct.pack(
        "<H HHII HHII HHIHH I", 3, 513, 4, 1, 68, 514, 4, 1, len(picture), 259, 3, 1, 6, 0, 0
    )
    tiff = b"II*\0\x08\0\0\0" + first + second
    tiff = tiff.ljust(68, b"\0") + picture
    body = b"Exif\0\0" + tiff
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + data[2:]


def _by_libjpeg(
    bits: int = 8, bands: int = 1, *, encodings: tuple[str, ...] = ("srgb",), **options: Any
) -> Maker:
    """Processes that only imagecodecs' libjpeg writes."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        numbers = quantised(smooth_scene(rng, bands), bits)
        data = imagecodecs.jpeg8_encode(last(numbers), bitspersample=bits, **options)
        lossless = options.get("lossless", False)
        words = ("lossless", f"{bits}-bit", f"{bits} bit") if bits > 8 or lossless else ()
        return PictureFile(
            save(path, ".jpg", data),
            numbers,
            encodings,
            2.0**bits - 1,
            loss=0 if lossless else _LOSS,
            must_name=words,
        )

    return make


def _cmyk(outcolour: str) -> Maker:
    """Adobe's CMYK and YCCK, in which no ink is 255."""

    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        inks = smooth_scene(rng, 4)
        inks[3] *= 0.3
        stored = 255 - quantised(inks, 8)
        data = imagecodecs.jpeg8_encode(
            last(stored), level=95, colorspace="cmyk", outcolorspace=outcolour, subsampling="444"
        )
        path = save(path, ".jpg", data)
        light = naive_rgb(1 - stored / 255.0)
        words = ("cmyk", "ycck", "inks")
        return PictureFile(path, None, (), light=light, loss=0.05, must_name=words, must_tell=words)

    return make


def _arithmetic(rng: np.random.Generator, path: Path) -> PictureFile:
    numbers = quantised(smooth_scene(rng, 1), 8)
    path = save(path, ".jpg", arithmetic_jpeg(numbers[0]))
    return PictureFile(path, numbers, ("srgb",), 255, loss=_LOSS, must_name=("arithmetic",))


def _two_pictures(rng: np.random.Generator, path: Path) -> PictureFile:
    numbers = quantised(smooth_scene(rng), 8)
    left, right = Image.fromarray(last(numbers)), Image.fromarray(255 - last(numbers))
    out = io.BytesIO()
    left.save(out, "MPO", save_all=True, append_images=[right], quality=95, subsampling=0)
    words = ("two", "2 ", "mpo", "pictures", "pages", "more than one")
    path = save(path, ".jpg", out.getvalue())
    return PictureFile(path, numbers, ("srgb",), 255, loss=_LOSS, must_tell=words, must_name=words)


def _gain_map(rng: np.random.Generator, path: Path) -> PictureFile:
    """Ultra HDR: what the base shows is 8-bit sRGB; a reader may apply the map, or tell of it."""
    numbers = quantised(smooth_scene(rng), 8)
    light = np.ones((*numbers.shape[1:], 4), np.float16)
    light[..., :3] = last(numbers / 255.0) ** 2.2 * 2
    data = imagecodecs.ultrahdr_encode(light, level=95)
    base = np.asarray(Image.open(io.BytesIO(bytes(data))).convert("RGB"))
    words = ("gain", "hdr", "two", "2 ", "pictures")
    return PictureFile(
        save(path, ".jpg", bytes(data)),
        np.moveaxis(base, -1, 0),
        ("srgb",),
        255,
        loss=_LOSS,
        must_tell=words,
        must_name=words,
    )


def _changed(change: Callable[[bytes], bytes], words: tuple[str, ...] = DAMAGED) -> Maker:
    def make(rng: np.random.Generator, path: Path) -> PictureFile:
        sound = _by_pillow()(rng, path)
        data = change(sound.path.read_bytes())
        sound.path.write_bytes(data)
        return PictureFile(sound.path, None, valid=False, must_name=words)

    return make


def _other_size(data: bytes) -> bytes:
    """A frame header that tells twice the rows that there are."""
    at = data.index(b"\xff\xc0")
    (rows,) = struct.unpack_from(">H", data, at + 5)
    return data[: at + 5] + struct.pack(">H", 2 * rows) + data[at + 7 :]


for _name, _maker in {
    "grey": _by_pillow(1),
    "YCbCr 4:4:4": _by_pillow(),
    "YCbCr 4:2:2": _by_pillow(subsampling=1),
    "YCbCr 4:2:0": _by_pillow(subsampling=2),
    "YCbCr 4:1:1": _by_libjpeg(bands=3, level=95, colorspace="rgb", subsampling="411"),
    "YCbCr 4:4:0": _by_libjpeg(bands=3, level=95, colorspace="rgb", subsampling="440"),
    "RGB without transform": _by_libjpeg(bands=3, level=95, colorspace="rgb", outcolorspace="rgb"),
    "RGB kept by Pillow": _by_pillow(keep_rgb=True),
    "progressive": _by_pillow(progressive=True),
    "restart markers": _by_pillow(restart_marker_blocks=3),
    "arithmetic": _arithmetic,
    "12 bits": _by_libjpeg(12, level=95, encodings=("srgb", "linear")),
    "lossless": _by_libjpeg(8, 3, lossless=True),
    "lossless of 12 bits": _by_libjpeg(12, lossless=True, encodings=("srgb", "linear")),
    "lossless of 16 bits": _by_libjpeg(16, lossless=True, encodings=("srgb", "linear")),
    "CMYK of Adobe": _cmyk("cmyk"),
    "YCCK of Adobe": _cmyk("ycck"),
    "orientation 2": _by_pillow(orientation=2),
    "orientation 3": _by_pillow(orientation=3),
    "orientation 6": _by_pillow(orientation=6),
    "orientation 8, grey": _by_pillow(1, orientation=8),
    "exposure in Exif": _by_pillow(exposure=True),
    "thumbnail in Exif": _by_pillow(thumbnail=True),
    "ICC sRGB": _by_pillow(icc=icc_profile("srgb")),
    "ICC linear": _by_pillow(icc=icc_profile(1), encodings=("linear",)),
    "ICC gamma 1.8": _by_pillow(icc=icc_profile(1.8), power=461 / 256),
    "ICC grey, linear": _by_pillow(1, icc=grey_profile(1), encodings=("linear",)),
    "two pictures (MPO)": _two_pictures,
    "gain map (Ultra HDR)": _gain_map,
    "named .png": _by_pillow(ending=".png"),
    "named .tif": _by_pillow(ending=".tif"),
    "named .JPEG": _by_pillow(ending=".JPEG"),
    "umlauts and blanks in the name": _by_pillow(ending=" für Ärger.jpg"),
    "text behind the picture": _by_pillow(tail=b"garbage" * 30),
    "cut": _changed(lambda d: d[: len(d) * 2 // 3]),
    "cut in the header": _changed(lambda d: d[:100]),
    "header tells twice the rows": _changed(_other_size),
}.items():
    add_kind(f"JPEG, {_name}", _maker)
