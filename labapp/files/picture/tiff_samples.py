"""Samples of a TIFF as light: photometric interpretation, palette, inks and alpha.

Sections are those of Adobe's TIFF 6.0 (1992).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from labapp.files.picture.encoding import LINEAR, SRGB, Encoding
from labapp.files.picture.stored import (
    ALPHA_LEFT_OUT,
    INKS_TURNED,
    StoredPicture,
    inks_to_colours,
    refuse_picture,
)

Samples = NDArray[Any]

_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE = range(4)
_INKS, _YCBCR, _LAB, _ICC_LAB = 5, 6, 8, 9
"""Values of the tag PhotometricInterpretation."""

_UNREADABLE = {
    4: "a mask of transparency",
    10: "in ITU L*a*b*",
    32803: "a RAW mosaic that isn't a DNG's",
    32844: "in LogL",
    32845: "in LogLuv",
    34892: "a linear RAW picture that isn't a DNG's",
    51177: "a map of depth",
}
"""Values of PhotometricInterpretation that aren't turned into light, in words."""

_JPEG, _WEBP = 7, 50001
"""Compressions whose decoders turn YCbCr into red, green and blue themselves."""

_ASSOCIATED, _UNASSOCIATED = 1, 2
"""Values of the tag ExtraSamples: alpha that is multiplied into the colours, and that isn't."""

_COEFFICIENTS, _REFERENCE, _INK_SET = 529, 532, 332


@dataclass(frozen=True, eq=False)
class TiffSamples:
    """A TIFF page, the value of its tag PhotometricInterpretation, and the bits of each sample."""

    page: tifffile.TiffPage
    photometric: int
    bits: int
    dtype: np.dtype[Any]

    @property
    def white(self) -> float | None:
        """The highest number that the bits hold; None for floating point."""
        if self.dtype.kind == "f":
            return None
        return float(2 ** (self.bits - (self.dtype.kind == "i")) - 1)


def to_light(path: Path, header: TiffSamples, samples: Samples, kind: str) -> StoredPicture:
    """Turn the decoded samples of a page, (samples, rows, columns), into light.

    kind: of the page, in words.
    Raises UserError, which names what the page is, for what can't be turned rightly.
    """
    if header.photometric in _UNREADABLE:
        raise refuse_picture(path, f"a TIFF that is {_UNREADABLE[header.photometric]}")
    if header.dtype.kind == "b":
        samples = samples.astype(np.uint8)
    colours, notes = _without_extra(path, header, samples)
    white = header.white
    encoding: Encoding | None = None
    told = done = ""
    if header.photometric == _PALETTE:
        colours = _from_palette(path, header, colours[0])
        encoding, told, done = SRGB, "a palette's colours are sRGB's", "its palette was applied"
        white = float(np.iinfo(colours.dtype).max)
    elif header.photometric in (_LAB, _ICC_LAB):
        colours, white = _from_lab(path, header, colours), None
        encoding, told = LINEAR, "CIELab was turned into linear sRGB"
        done = f"its {told}"
    elif header.photometric == _INKS:
        colours = _from_inks(path, header, colours)
        encoding, told, done = SRGB, "inks stand for colours of a screen", INKS_TURNED
    elif header.photometric == _WHITE_IS_ZERO:
        colours = _inverse(path, header, colours)
    elif header.photometric == _YCBCR and _is_ycbcr(header):
        colours = _from_ycbcr(path, header, colours)
    if white is not None and white < 255 and colours.dtype.kind != "i":
        # Numbers of fewer than 8 bits over the range of 8, as in other kinds of pictures.
        colours, white = (colours * np.uint8(255 // white)).astype(np.uint8), 255.0
    notes = (*notes, done) if done else notes
    return StoredPicture(colours, kind, white, encoding, told, notes=notes)


def _colour_count(header: TiffSamples) -> int:
    """Return how many samples are colours by the photometric interpretation."""
    if header.photometric == _INKS:
        return 4
    if header.photometric in (_RGB, _YCBCR, _LAB, _ICC_LAB):
        return 3
    # Three planes without a word on what they are: red, green and blue for most programs.
    grey = header.photometric in (_WHITE_IS_ZERO, _BLACK_IS_ZERO)
    page = header.page
    return 3 if grey and page.samplesperpixel == 3 and not page.extrasamples else 1


def _without_extra(
    path: Path, header: TiffSamples, samples: Samples
) -> tuple[Samples, tuple[str, ...]]:
    """Return the colours without alpha and other samples, and remarks."""
    count = _colour_count(header)
    if len(samples) < count:
        raise refuse_picture(path, f"a TIFF of {len(samples)} samples a pixel, and needs {count}")
    if len(samples) > 4 and count == 1:
        raise refuse_picture(
            path, f"a TIFF of {len(samples)} bands a pixel",
            "Save the band that is meant, or red, green and blue, as a picture of its own.",
        )  # fmt: skip
    if len(samples) == count:
        is_told = count != 3 or header.photometric not in (_WHITE_IS_ZERO, _BLACK_IS_ZERO)
        return samples, () if is_told else ("its three samples were taken as red, green and blue",)
    extra = tuple(int(one) for one in header.page.extrasamples)[: len(samples) - count]
    if len(samples) == count + 1 and extra in ((_ASSOCIATED,), (_UNASSOCIATED,)):
        over = " over black" if extra == (_ASSOCIATED,) else ""
        return samples[:count], (ALPHA_LEFT_OUT + over,)
    told = (
        f"{len(samples) - count} samples a pixel beside its colours, alpha or others, were left out"
    )
    return samples[:count], (told,)


def _inverse(path: Path, header: TiffSamples, grey: Samples) -> Samples:
    """Return numbers that grow with light from those of WhiteIsZero."""
    if header.white is not None:
        # Bits that are the other way round, for signed numbers too.
        lowest = -header.white - 1 if header.dtype.kind == "i" else 0.0
        return (grey.dtype.type(header.white + lowest) - grey).astype(grey.dtype)
    if not (np.nanmin(grey) >= 0 and np.nanmax(grey) <= 1):
        raise refuse_picture(
            path, f"a TIFF of floating-point WhiteIsZero with numbers from {np.nanmin(grey):g} to "
            f"{np.nanmax(grey):g}, in which black isn't known",
            "Save it as BlackIsZero.",
        )  # fmt: skip
    return 1 - grey


def _from_palette(path: Path, header: TiffSamples, numbers: Samples) -> Samples:
    """Return the colours that a palette's numbers stand for (section 5)."""
    table = header.page.colormap
    if table is None or int(numbers.max()) >= table.shape[1]:
        raise refuse_picture(path, "a TIFF with a palette that isn't there, or is too short")
    # Most programs fill the 16 bits from 8, by 257 or by 256.
    for step in (257, 256):
        if not (table % step).any() and table.max() <= 255 * step:
            table = (table // step).astype(np.uint8)
            break
    return np.ascontiguousarray(table[:, numbers])


def _from_inks(path: Path, header: TiffSamples, inks: Samples) -> Samples:
    """Return red, green and blue of cyan, magenta, yellow and black by plain subtraction."""
    if header.page.tags.valueof(_INK_SET, 1) != 1 or header.white is None:
        raise refuse_picture(path, "a TIFF of inks that aren't CMYK of whole numbers")
    return inks_to_colours(
        (header.white - inks.astype(np.float64)).astype(inks.dtype), header.white
    )


def _is_ycbcr(header: TiffSamples) -> bool:
    """Return whether decoded samples are still luma and chroma."""
    page = header.page
    if page.is_subsampled or page.compression == _WEBP:
        return False
    return page.compression != _JPEG or page.planarconfig == 2


def _from_ycbcr(path: Path, header: TiffSamples, samples: Samples) -> Samples:
    """Return red, green and blue of luma and chroma (section 21)."""
    if header.bits != 8:
        raise refuse_picture(path, f"a TIFF of YCbCr with {header.bits} bits")
    tags = header.page.tags
    red, green, blue = _ratios(tags.valueof(_COEFFICIENTS), (0.299, 0.587, 0.114))
    limits = _ratios(tags.valueof(_REFERENCE), (0.0, 255.0, 128.0, 255.0, 128.0, 255.0))
    luma, first, second = (
        (plane.astype(np.float64) - low) * full / (high - low)
        for plane, low, high, full in zip(
            samples, limits[::2], limits[1::2], (255.0, 127.0, 127.0), strict=True
        )
    )
    reds = luma + second * (2 - 2 * red)
    blues = luma + first * (2 - 2 * blue)
    greens = (luma - blue * blues - red * reds) / green
    return np.rint(np.clip([reds, greens, blues], 0, 255)).astype(np.uint8)


def _ratios(told: Any, default: tuple[float, ...]) -> tuple[float, ...]:
    """Return the numbers of a tag of ratios, each two whole numbers; the default where it isn't."""
    if told is None or len(told) != 2 * len(default):
        return default
    pairs = zip(told[::2], told[1::2], strict=True)
    return tuple(over / max(under, 1) for over, under in pairs)


_D50 = np.array([0.9642, 1.0, 0.8249])
"""White of CIELab in TIFF (section 23 names D65, and programs write the profile connection space's
D50 of ICC.1)."""

_D50_TO_SRGB = np.array(
    [
        [3.1338561, -1.6168667, -0.4906146],
        [-0.9787684, 1.9161415, 0.0334540],
        [0.0719453, -0.2289914, 1.4052427],
    ]
)
"""Linear sRGB of XYZ under D50, adapted to D65 by Bradford's method (IEC 61966-2-1, ICC.1)."""


def _from_lab(path: Path, header: TiffSamples, lab: Samples) -> Samples:
    """Return linear sRGB of CIE L*a*b* (section 23, and ICC's of the technical note)."""
    if header.bits not in (8, 16) or header.dtype.kind not in "ui":
        raise refuse_picture(
            path, f"a TIFF of CIELab with {header.bits}-bit {header.dtype} numbers"
        )
    unit = 1 if header.bits == 8 else 256
    unsigned = lab.view(f"u{header.bits // 8}")
    if header.photometric == _LAB:
        lightness = unsigned[0] * (100 / (2**header.bits - 1))
        chroma = unsigned[1:].view(f"i{header.bits // 8}") / unit
    else:
        lightness = unsigned[0] * (100 / (255 * unit))
        chroma = unsigned[1:] / unit - 128
    middle = (lightness + 16) / 116
    roots = np.stack([middle + chroma[0] / 500, middle, middle - chroma[1] / 200])
    xyz = np.where(roots > 6 / 29, roots**3, 3 * (6 / 29) ** 2 * (roots - 4 / 29))
    light = np.einsum("ij,jyx->iyx", _D50_TO_SRGB, xyz * _D50[:, None, None])
    return np.clip(light, 0, 1).astype(np.float32)
