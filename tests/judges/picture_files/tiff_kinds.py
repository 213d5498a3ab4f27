"""Kinds of TIFF files: bits, photometrics, planes, alpha, compressions, tags and faults."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np

from judges.picture_files import tiff_bytes as t
from judges.picture_files.icc import grey_profile, icc_profile
from judges.picture_files.tiff_bytes import FLOAT, SIGNED, Layout, tiff_file, tiff_page
from judges.picture_files.truth import (
    Numbers,
    PictureFile,
    add_kind,
    last,
    quantised,
    save,
    scene,
)

ASSOCIATED, UNASSOCIATED, UNSPECIFIED = 1, 2, 0

COMPRESSION_NAMES = {
    t.LZW: "lzw",
    t.DEFLATE: "deflate",
    t.PACKBITS: "packbits",
    t.LERC: "lerc",
    t.JPEG_2000: "jpeg 2000",
    t.LZMA: "lzma",
    t.PNG: "png",
    t.JPEG_XR: "jpeg xr",
    t.ZSTD: "zstd",
    t.WEBP: "webp",
    t.JPEG_XL: "jpeg xl",
    t.THUNDERSCAN: "thunderscan",
}


_USUAL = Layout()


@dataclass(frozen=True)
class TiffKind:
    """A TIFF of a random scene: its layout, colours and words."""

    layout: Layout = _USUAL
    bands: int = 3
    order: str = "<"
    big: bool = False
    must_name: tuple[str, ...] = ()
    must_tell: tuple[str, ...] = ()
    encodings: tuple[str, ...] = ()
    icc: bytes = b""
    orientation: int = 1
    ending: str = ".tif"
    tail: bytes = b""

    def __call__(self, rng: np.random.Generator, path: Path) -> PictureFile:
        numbers, stored, also = self.samples(rng)
        page = tiff_page(stored, self.complete_layout(), self.order)
        path = save(path, self.ending, tiff_file([page], self.order, self.big) + self.tail)
        found = self.described(path, numbers)
        return replace(found, also=also, also_loss=self.rounding if also else 0.0)

    @property
    def rounding(self) -> float:
        """Share of white by which colours that were divided by alpha are rounded."""
        return 1.01 / (2**self.layout.bits - 1) if self.layout.form == t.UNSIGNED else 1e-4

    def described(self, path: Path, numbers: Numbers) -> PictureFile:
        """What the file at a path holds."""
        layout = self.layout
        whole = layout.form == t.UNSIGNED
        bits = layout.bits
        usual = ("linear",) if not whole or bits > 8 else ("srgb",)
        if whole and bits < 8:
            usual = ("srgb", "linear")
        return PictureFile(
            path,
            numbers,
            self.encodings or usual,
            white=2.0**bits - 1 if whole else None,
            orientation=self.orientation,
            must_name=self.must_name + self.words(),
            must_tell=self.must_tell or (("alpha", "channel", "sample") if layout.extra else ()),
        )

    def words(self) -> tuple[str, ...]:
        """By any of which a refusal names what is special about the file."""
        layout, found = self.layout, []
        if layout.compression in COMPRESSION_NAMES:
            found.append(COMPRESSION_NAMES[layout.compression])
        if layout.bits not in (8, 16) or layout.form != t.UNSIGNED:
            found += [f"{layout.bits}-bit", f"{layout.bits} bit", f"float{layout.bits}"]
            found += ["signed"] if layout.form == SIGNED else []
        if layout.photometric == 0 and layout.form == FLOAT:
            found.append("whiteiszero")
        if layout.extra:
            found += ["alpha", "extra", f"{self.bands + len(layout.extra)} bands"]
        return tuple(found)

    def complete_layout(self) -> Layout:
        tags: dict[int, t.Tag] = dict(self.layout.tags)
        if self.icc:
            tags[34675] = (7, self.icc)
        if self.orientation != 1:
            tags[274] = (3, [self.orientation])
        photometric = 2 if self.bands == 3 and self.layout.photometric == 1 else None
        return replace(
            self.layout,
            tags=tags,
            photometric=self.layout.photometric if photometric is None else photometric,
        )

    def samples(self, rng: np.random.Generator) -> tuple[Numbers, Numbers, tuple[Numbers, ...]]:
        """What is to be found, (rows, columns, samples) as stored, and what is right as well."""
        layout = self.layout
        light = scene(rng, self.bands + len(layout.extra))
        values = numbers_of(light, layout)
        numbers, others = values[: self.bands], values[self.bands :]
        stored = numbers
        if layout.photometric == 0:
            # Floats have no highest number: what is stored is 1 less the light.
            top = numbers_of_white(layout)
            stored = (top - numbers).astype(numbers.dtype)
            numbers = (top - stored).astype(numbers.dtype)
        if ASSOCIATED in layout.extra:
            alpha = light[self.bands + layout.extra.index(ASSOCIATED)]
            stored = numbers_of(light[: self.bands] * alpha, layout)
            numbers = stored
        stored = np.concatenate([stored, others])
        return numbers, np.moveaxis(stored, 0, -1), self._also(numbers, stored)

    def _also(self, numbers: Numbers, stored: Numbers) -> tuple[Numbers, ...]:
        """Colours divided by the alpha in them; samples of no meaning taken for colours."""
        extra = self.layout.extra
        inverted = self.layout.photometric == 0
        if self.bands == 1 and extra == (UNSPECIFIED, UNSPECIFIED):
            return (numbers_of_white(self.layout) - stored if inverted else stored,)
        if ASSOCIATED not in extra or self.layout.form == SIGNED:
            return ()
        top = numbers_of_white(self.layout)
        alpha = stored[self.bands + extra.index(ASSOCIATED)].astype(np.float64)
        return (numbers * np.where(alpha > 0, top / np.maximum(alpha, 1e-9), 1.0),)


def numbers_of_white(layout: Layout) -> float:
    """The highest number of a form, or 1."""
    return 1.0 if layout.form == FLOAT else 2**layout.bits - 1


def numbers_of(light: Numbers, layout: Layout) -> Numbers:
    """Light between 0 and 1 as numbers of a layout's form."""
    bits = layout.bits
    if layout.form == FLOAT:
        wide = {16: np.float16, 32: np.float32, 64: np.float64}[bits]
        return light.astype(wide)
    if layout.form == SIGNED:
        return np.rint((light - 0.3) * (2 ** (bits - 1) - 1)).astype(f"i{bits // 8}")
    if bits > 32:
        return (light * 2.0**40).astype(np.uint64)
    return quantised(light, bits)


def _add(name: str, bands: int = 3, **options: Any) -> None:
    """Register a kind by the layout's and the kind's fields."""
    mine = {k: options.pop(k) for k in list(options) if k in TiffKind.__dataclass_fields__}
    add_kind(f"TIFF, {name}", TiffKind(Layout(**options), bands, **mine))


def _add_depths() -> None:
    for bits in (1, 2, 4, 8, 10, 12, 14, 16, 24, 32):
        # Of 24 bits, readers differ in what little endian means.
        _add(f"grey of {bits} bits", 1, bits=bits, order=">" if bits == 24 else "<")
    for bits in (2, 4, 10, 12, 14, 16):
        _add(f"RGB of {bits} bits", bits=bits)
    for bits in (8, 16, 32):
        _add(f"grey of {bits} bits, signed", 1, bits=bits, form=SIGNED)
    for bits in (16, 32, 64):
        _add(f"grey float of {bits} bits", 1, bits=bits, form=FLOAT)
    _add("RGB float of 16 bits", bits=16, form=FLOAT)
    _add("RGB float of 32 bits, separate planes", bits=32, form=FLOAT, separate=True)
    _add("grey of 64 bits", 1, bits=64)
    for bits in (1, 4, 8, 12, 16):
        _add(f"WhiteIsZero of {bits} bits", 1, bits=bits, photometric=0)
    _add("WhiteIsZero float", 1, bits=32, form=FLOAT, photometric=0)


def _add_layouts() -> None:
    _add("RGB of 8 bits, separate planes", separate=True)
    _add("RGB of 16 bits, separate planes", bits=16, separate=True)
    _add("RGB of 16 bits, separate planes in strips", bits=16, separate=True, strip=7)
    _add("tiles of 16, odd edges", bits=16, tile=(16, 16))
    _add("tiles of 32 x 16, separate planes", tile=(32, 16), separate=True)
    _add("strips of one row", bits=16, strip=1)
    _add("reverse fill order, 1 bit", 1, bits=1, reverse_bits=True, must_name=("fill",))
    _add("reverse fill order, 8 bits", reverse_bits=True, must_name=("fill",))
    _add("big endian, 16 bits", bits=16, order=">")
    _add("big endian float", 1, bits=32, form=FLOAT, order=">")
    _add("BigTIFF, 16 bits", bits=16, big=True)
    _add("BigTIFF, big endian, tiles", bits=16, big=True, order=">", tile=(16, 32))
    _add("BigTIFF named .tif, float", 1, bits=32, form=FLOAT, big=True)


def _add_extras() -> None:
    for bits in (8, 16):
        _add(f"RGBA of {bits} bits, unassociated", bits=bits, extra=(UNASSOCIATED,))
        _add(f"RGBA of {bits} bits, associated", bits=bits, extra=(ASSOCIATED,))
        _add(f"grey and alpha of {bits} bits", 1, bits=bits, extra=(UNASSOCIATED,))
    _add("RGBA, separate planes", bits=16, separate=True, extra=(UNASSOCIATED,))
    _add("RGBA float", bits=32, form=FLOAT, extra=(UNASSOCIATED,))
    _add("RGB and two more samples", bits=16, extra=(UNASSOCIATED, UNSPECIFIED))
    _add("RGB and one sample of no meaning", bits=8, extra=(UNSPECIFIED,))
    _add("grey and two samples of no meaning", 1, bits=16, extra=(UNSPECIFIED, UNSPECIFIED))


def _add_compressions() -> None:
    _add("LZW", compression=t.LZW)
    _add("LZW, predictor", compression=t.LZW, predictor=2, strip=9)
    _add("LZW, predictor, 16 bits", bits=16, compression=t.LZW, predictor=2)
    _add("LZW, predictor 3, float", 1, bits=32, form=FLOAT, compression=t.LZW, predictor=3)
    _add("deflate", compression=t.DEFLATE, predictor=2)
    _add("deflate of Adobe's first number", compression=t.OLD_DEFLATE, bits=16)
    _add("deflate, predictor 3, RGB of doubles", bits=64, form=FLOAT, compression=8, predictor=3)
    _add("deflate, predictor 3, half", 1, bits=16, form=FLOAT, compression=8, predictor=3)
    _add("PackBits", compression=t.PACKBITS)
    _add("PackBits of 1 bit", 1, bits=1, compression=t.PACKBITS)
    _add("zstd", bits=16, compression=t.ZSTD)
    _add("zstd, predictor", bits=16, compression=t.ZSTD, predictor=2, strip=5)
    _add("LZMA", bits=16, compression=t.LZMA)
    _add("JPEG 2000 inside", compression=t.JPEG_2000)
    _add("JPEG 2000 inside, 16 bits", 1, bits=16, compression=t.JPEG_2000, tile=(32, 32))
    _add("JPEG XL inside", compression=t.JPEG_XL)
    _add("JPEG XL inside, 16 bits", 1, bits=16, compression=t.JPEG_XL)
    _add("PNG inside", bits=8, compression=t.PNG)
    _add("PNG inside, 16 bits", bits=16, compression=t.PNG)
    _add("WebP inside", compression=t.WEBP)
    _add("LERC inside", 1, bits=16, compression=t.LERC)
    _add("LERC inside, float", 1, bits=32, form=FLOAT, compression=t.LERC)
    _add("JPEG XR inside", 1, bits=16, compression=t.JPEG_XR)
    _add("Thunderscan", 1, bits=4, compression=t.THUNDERSCAN)


def _add_tags() -> None:
    for number in (2, 3, 6, 8):
        _add(f"orientation {number}", bits=16, orientation=number)
    _add("orientation of any number", 1, bits=8, orientation=5, compression=t.LZW)
    _add("ICC linear, 8 bits", icc=icc_profile(1.0), encodings=("linear",), must_name=("icc",))
    _add("ICC sRGB, 16 bits", icc=icc_profile("srgb"), bits=16, encodings=("srgb",))
    _add("ICC sRGB of v4", icc=icc_profile("parametric"), encodings=("srgb",))
    _add("ICC grey, linear", 1, icc=grey_profile(1.0), encodings=("linear",), must_name=("icc",))
    marks: dict[int, t.Tag] = {282: (5, [(0, 0)]), 283: (5, [(7, 0)]), 296: (3, [9])}
    _add("odd resolutions", bits=16, tags=marks)
    _add("MinSampleValue and MaxSampleValue", 1, bits=16, tags={280: (3, [9]), 281: (3, [60000])})
    _add("private tags", bits=16, tags={65000: (2, "lab"), 65123: (12, [1.5, 2.5])})
    _add("text behind the picture", bits=16, tail=b"garbage " * 40)
    _add("bits told once for three samples", tags={258: (3, [8])})
    _add("bits told once, 16 bits", bits=16, tags={258: (3, [16])}, strip=8)
    _add("no strip byte counts", bits=16, tags={279: ()}, must_name=("count",))
    _add("no rows per strip", bits=16, tags={278: ()})
    _add("no sample format, no planes", bits=16, tags={339: (), 284: ()})
    _add("named .jpg", bits=16, ending=".jpg")
    _add("named .TIFF", bits=16, ending=".TIFF")


def _encoded_icc(rng: np.random.Generator, path: Path, gamma: float) -> PictureFile:
    """A power other than sRGB's, told by the profile."""
    numbers = quantised(scene(rng), 16)
    layout = Layout(16, photometric=2, tags={34675: (7, icc_profile(gamma))})
    path = save(path, ".tif", tiff_file([tiff_page(last(numbers), layout)]))
    # A profile holds the exponent in 256ths.
    light = (numbers / 65535.0) ** (round(gamma * 256) / 256)
    return PictureFile(path, numbers, (), 65535, light=light, must_name=("icc", "profile", "gamma"))


def _float24(rng: np.random.Generator, path: Path) -> PictureFile:
    """Held against what imagecodecs makes of its own 24 bits."""
    light = scene(rng, 1).astype(np.float32)
    data = bytes(imagecodecs.float24_encode(light[0], byteorder="<"))
    back = imagecodecs.float24_decode(data, byteorder="<").reshape(light.shape)
    page = tiff_page(light[0], Layout(24, FLOAT))
    page.segments = [data]
    path = save(path, ".tif", tiff_file([page]))
    return PictureFile(path, back, must_name=("24-bit", "24 bit", "float24"))


_add_depths()
add_kind("TIFF, grey float of 24 bits", _float24)
_add_layouts()
_add_extras()
_add_compressions()
_add_tags()
for _gamma in (1.8, 2.2):
    add_kind(
        f"TIFF, ICC gamma {_gamma}", lambda rng, path, gamma=_gamma: _encoded_icc(rng, path, gamma)
    )
