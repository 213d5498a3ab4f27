"""TIFF by tifffile, whose answer is held against the file's own tags.

The numbers come as they are stored: those of 10, 12 and 14 bits aren't stretched to 16, planes are
read one by one, and orientation is told and not applied.
"""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import tifffile
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.exif import read_exif
from labapp.files.guarded_reading import require_memory
from labapp.files.picture.encoding import Statement, statement_of
from labapp.files.picture.icc import icc_encoding
from labapp.files.picture.stored import StoredPicture, refuse_picture
from labapp.files.picture.tiff_samples import TiffSamples, to_light

_REDUCED, _MASK = 1, 4
"""Bits of NewSubfileType that say that a page is a smaller copy or a mask of another (Adobe, TIFF
6.0, section 8)."""

_LOSSY = frozenset({6, 7, 33003, 33004, 33005, 33007, 34712, 34887, 34892, 50001, 50002, 52546})
"""Compressions that lose something or may: JPEG in its kinds, JPEG 2000, LERC, WebP, JPEG XL."""

_JPEGS = frozenset({7, 33007, 34892})
"""Those of them that are JPEG, whose decoders see to subsampled chroma."""

_OLD_JPEG = 6
"""JPEG as TIFF 6.0 had it, before its technical note 2; decoders differ on its colours."""

_NUMBER_KINDS = {
    1: "whole numbers", 2: "signed numbers", 3: "floating point", 6: "complex numbers",
}  # fmt: skip
"""What a page holds by its tag SampleFormat (TIFF 6.0, section 19)."""

_DEPTH, _ICC, _TRANSFER = 32997, 34675, 301

# What it says is either harmless or followed by an exception, which is told.
logging.getLogger("tifffile").setLevel(logging.CRITICAL + 1)


def count_tiff_pages(data: bytes) -> int:
    """Return how many pictures a TIFF holds, without smaller copies and masks."""
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            return max(len(_pages(file)), _hidden_frames(file))
    # A damaged file makes tifffile raise whatever its numbers lead to.
    except Exception:
        return 1


def read_tiff(path: Path, data: bytes, page: int = 0) -> StoredPicture:
    """Read a page of a TIFF as the light and numbers that it stores.

    page: counts from 0, without smaller copies and masks.
    Raises UserError, which says what the file is, if it is damaged, or of a kind that can't be read
    rightly.
    """
    with _damage_told(path), tifffile.TiffFile(io.BytesIO(data)) as file:
        found = _pages(file)
        count = max(len(found), _hidden_frames(file))
        if not found:
            what = "a TIFF without a picture, cut short or damaged"
            raise refuse_picture(path, what, "Get the original.")
        part = found[page] if len(found) == count else found[0]
        others = len(file.pages) - len(found) + len(part.subifds or ())
        header = _header(path, part)
        _require_readable(path, part, len(data), header)
        values = _decode(part, data)
        if len(found) != count:
            # One of the frames behind a single page.
            every = file.series[0].asarray(squeeze=False)
            values = np.asarray(every.reshape(-1, *values.shape)[page])
        light = to_light(path, header, _require_bands(path, part, values), _kind(part))
        stated = statement_of(lambda: _encoding(part))
        told = f"{others} of its pages are smaller copies or masks, and were passed over"
        return replace(
            light,
            encoding=light.encoding or stated.encoding,
            encoding_source=light.encoding_source or stated.source,
            encoding_refusal="" if light.encoding else stated.refusal,
            pages=count,
            orientation=_orientation(part),
            exif=read_exif(data, part.offset),
            is_lossy=int(part.compression) in _LOSSY,
            notes=(*light.notes, *stated.notes, *((told,) if others else ())),
        )


@contextmanager
def _damage_told(path: Path) -> Iterator[None]:
    """Raise UserError for whatever tifffile and its decoders raise."""
    try:
        yield
    except (UserError, KeyboardInterrupt):
        raise
    except MemoryError as error:
        raise refuse_picture(path, "a TIFF for which there is too little memory") from error
    except Exception as error:
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        what = "of a kind that isn't read" if "not supported" in reason else "damaged, or cut short"
        raise refuse_picture(path, f"a TIFF that is {what} ({reason})") from error


def _pages(file: tifffile.TiffFile) -> list[tifffile.TiffPage]:
    """Return the pages that are pictures in their own right."""
    # A page that is followed by itself is counted once by its length, and for ever by iteration.
    every = [file.pages[number] for number in range(len(file.pages))]
    # tifffile keeps only some of the tags of pages that look alike.
    pages = [page.aspage() if isinstance(page, tifffile.TiffFrame) else page for page in every]
    whole = [page for page in pages if not int(page.subfiletype) & (_REDUCED | _MASK)]
    return whole or pages[:1]


def _hidden_frames(file: tifffile.TiffFile) -> int:
    """Return the frames that lie one after the other behind a single page; 0 if there are none.

    ImageJ writes stacks so, and tifffile where it is told to leave out the other pages.
    """
    if len(file.pages) != 1 or not (file.is_imagej or file.is_shaped):
        return 0
    page = file.pages.first
    frames = math.prod(file.series[0].get_shape(False)) // max(math.prod(page.shape), 1)
    return frames if frames > 1 else 0


def _decode(part: tifffile.TiffPage, data: bytes) -> NDArray[Any]:
    """Decode a page to (planes, depth, rows, columns, samples)."""
    if not part.is_subsampled or int(part.compression) in _JPEGS:
        return part.asarray(squeeze=False, maxworkers=1)
    # Of subsampled chroma, libtiff makes red, green and blue, partly turned.
    rgba = imagecodecs.tiff_decode(data, index=part.index, asrgb=True)
    turned = _orientation(part)
    rows = rgba[::-1] if turned in (3, 4, 7, 8) else rgba
    columns = rows[:, ::-1] if turned in (2, 3, 6, 7) else rows
    return columns[None, None, ..., :3]


def _header(path: Path, part: tifffile.TiffPage) -> TiffSamples:
    """Return what the tags of a page say about its samples."""
    if int(part.imagedepth) > 1 or (_DEPTH in part.tags and part.tags[_DEPTH].value > 1):
        raise refuse_picture(path, "a TIFF of a volume, with several planes of depth")
    if int(part.compression) == _OLD_JPEG:
        raise refuse_picture(path, "a TIFF of old-style JPEG (compression 6)")
    bits = part.bitspersample
    if not isinstance(bits, int):
        bits = bits[0] if len(set(bits)) == 1 else 0
    # Whole numbers of 24 bits are decoded wrongly; floating-point ones aren't.
    if part.dtype is None or bits == 0 or (bits == 24 and part.dtype.kind != "f"):
        told = "x".join(map(str, np.atleast_1d(part.bitspersample)))
        kind = _NUMBER_KINDS.get(int(part.sampleformat), "of an unknown kind")
        raise refuse_picture(path, f"a TIFF with samples of {told} bits, {kind}")
    return TiffSamples(part, int(part.photometric), bits, part.dtype)


def _require_readable(
    path: Path, part: tifffile.TiffPage, stored: int, header: TiffSamples
) -> None:
    """Raise UserError for a page without all its data, or that would take too much memory."""
    tile = max(int(part.tilewidth), 1) * max(int(part.tilelength), 1)
    count = max(math.prod(part.shaped), tile * part.samplesperpixel)
    what = f"a picture of {part.imagewidth} x {part.imagelength} pixels by its header"
    require_memory(path, stored, count * header.dtype.itemsize, what, pixels=count)
    needed = math.prod(part.chunked)
    ends = [sum(one) for one in zip(part.dataoffsets, part.databytecounts, strict=False)]
    if len(ends) < needed or not all(part.databytecounts[:needed]):
        raise refuse_picture(path, "a TIFF some of whose strips or tiles are missing")
    if max(ends[:needed]) > stored:
        raise refuse_picture(
            path, f"a TIFF that is cut short: {stored} of {max(ends)} bytes are there"
        )


def _require_bands(path: Path, part: tifffile.TiffPage, values: NDArray[Any]) -> NDArray[Any]:
    """Return decoded (planes, depth, rows, columns, samples) as (samples, rows, columns).

    Raises UserError if they aren't of the size and kind that the page's tags say.
    """
    planes, _, rows, columns, samples = values.shape
    wanted = (part.imagelength, part.imagewidth, part.samplesperpixel, part.dtype)
    kind = values.dtype.newbyteorder("=")
    if (rows, columns, planes * samples, kind) != wanted:
        raise refuse_picture(
            path, f"a TIFF whose data are {columns} x {rows} pixels of {planes * samples} "
            f"{values.dtype} samples, and by its header {part.imagewidth} x {part.imagelength}"
        )  # fmt: skip
    moved = np.moveaxis(values[:, 0], -1, 1).reshape(planes * samples, rows, columns)
    return moved.astype(kind, copy=False)


def _encoding(part: tifffile.TiffPage) -> Statement:
    """Return the encoding that a page's colour profile states, with remarks."""
    if _ICC in part.tags:
        return icc_encoding(bytes(part.tags[_ICC].value))
    if _TRANSFER in part.tags:
        return Statement(None, "", ("its tag TransferFunction was passed over: name its encoding",))
    return Statement(None)


def _orientation(part: tifffile.TiffPage) -> int:
    """Return the orientation that a page's tag says, 1 to 8; 1 where it says none."""
    told = part.tags.valueof(274, 1)
    return int(told) if told in range(1, 9) else 1


def _kind(part: tifffile.TiffPage) -> str:
    """Return a page's kind in words: bits, and compression if there is any."""
    bits = "x".join(map(str, dict.fromkeys(np.atleast_1d(part.bitspersample).tolist())))
    number = " floating-point" if int(part.sampleformat) == 3 else ""
    if int(part.compression) == 1:
        return f"{bits}-bit{number} TIFF"
    name = getattr(part.compression, "name", str(part.compression)).replace("_", " ")
    return f"{bits}-bit{number} TIFF, {name}"
