"""PNG, JPEG and other coded pictures by imagecodecs, whose answer is held against the header.

imagecodecs keeps bits and transparency, and costs no more than OpenCV. OpenCV decodes Windows
bitmaps, all of whose kinds it knows, and says what is wrong with a JPEG's data, which others don't.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from labapp.common.library_text import collect_library_text
from labapp.files.exif import Exif
from labapp.files.guarded_reading import require_memory
from labapp.files.picture.boxed_formats import (
    exif_of_heif,
    exif_of_jpeg_xl,
    heif_encoding,
    orientation_of_heif,
    read_jpeg_xl_header,
)
from labapp.files.picture.encoding import Statement, statement_of
from labapp.files.picture.file_parts import (
    count_gif_frames,
    exif_of_jpeg,
    exif_of_png,
    exif_of_webp,
    jpeg_segments,
    riff_chunks,
)
from labapp.files.picture.headers import Header
from labapp.files.picture.icc import icc_encoding
from labapp.files.picture.stated_encoding import icc_of_jpeg, icc_of_webp, is_drawing, png_encoding
from labapp.files.picture.stored import (
    ALPHA_LEFT_OUT,
    INKS_TURNED,
    StoredPicture,
    inks_to_colours,
    refuse_picture,
)

_MOST_SCANS = 100
"""Scans of a progressive JPEG, each of which goes over the whole picture. Encoders write about 10
(ITU-T T.81, section G); a file can hold thousands. Chosen."""

_SCAN, _END = b"\xff\xda", b"\xff\xd9"
"""JPEG's markers before each scan, and at the end of a picture."""

Samples = NDArray[Any]

_LIBRARY_TEXT = re.compile(
    rb"^(?:PNG warning|libpng|Corrupt JPEG|Premature end|.*cv::)[^\n]*", re.M
)
"""Lines that decoders write to the terminal by themselves."""

_COLOUR_TYPE, _INTERLACE = 25, 28
"""Places of a PNG's kind of colours and of whether it is interlaced (third edition, 11.2.1)."""

_BLOCK = 8
"""Rows of a JPEG's block: what has no data ends in rows that are alike."""


def _decode_by_opencv(data: bytes) -> Samples:
    """Decode by OpenCV, with alpha as it is; what its libraries say is caught."""
    import cv2

    with collect_library_text(_LIBRARY_TEXT) as said:
        found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if found is None:
        raise ValueError(said[0] if said else "OpenCV can't decode it")
    if found.ndim == 2:
        return found
    return found[..., [2, 1, 0, *range(3, found.shape[-1])]]


def _decode_png(data: bytes) -> Samples:
    """Decode a PNG; interlaced ones by OpenCV, as imagecodecs writes a warning of each."""
    if not data[_INTERLACE]:
        return imagecodecs.png_decode(data)
    found = _decode_by_opencv(data)
    is_grey = data[_COLOUR_TYPE] in (0, 4) and found.ndim == 3
    return found[..., [0, -1]] if is_grey else found


_DECODERS: dict[str, Callable[[bytes], Samples]] = {
    "PNG": _decode_png,
    "JPEG": imagecodecs.jpeg8_decode,
    "BMP": _decode_by_opencv,
    "WebP": imagecodecs.webp_decode,
    "GIF": lambda data: imagecodecs.gif_decode(data, index=0),
    "JPEG 2000": imagecodecs.jpeg2k_decode,
    "JPEG XL": lambda data: imagecodecs.jpegxl_decode(data, index=0, keeporientation=True),
    "AVIF": lambda data: imagecodecs.avif_decode(data, index=0),
    "JPEG XR": imagecodecs.jpegxr_decode,
    "JPEG-LS": imagecodecs.jpegls_decode,
    "QOI": imagecodecs.qoi_decode,
    "Sun raster": _decode_by_opencv,
}
"""What decodes each format to (rows, columns[, samples]), red first."""


def read_coded(path: Path, data: bytes, header: Header) -> StoredPicture:
    """Read the bytes of a coded picture, of which `header` was found.

    Raises UserError, which says what the file is, if it is damaged, asks for too much memory, or
    what is decoded isn't what the header says.
    """
    if header.kind not in _DECODERS:
        raise refuse_picture(path, f"a {header.kind}, which has no decoder")
    size = header.width * header.height * 4 * (2 if (header.bits or 16) > 8 else 1)
    what = f"a picture of {header.width} x {header.height} pixels by its header"
    require_memory(path, len(data), size, what, pixels=header.width * header.height)
    if header.kind == "JPEG":
        # Decoders fill a JPEG that ends early with grey. Thumbnails have ends of their own.
        scan = 2 + sum(4 + len(content) for _, content in jpeg_segments(data))
        if data.find(_END, scan) < 0:
            raise refuse_picture(path, "a JPEG that is cut short", "Get the original.")
        if data.count(_SCAN) > _MOST_SCANS:
            what = f"a JPEG of more than {_MOST_SCANS} scans, as no program writes"
            raise refuse_picture(path, what, "Save it anew.")
    if header.kind == "PNG" and is_drawing(data):
        what = "a drawing that labapp made to look at, and holds no light"
        raise refuse_picture(path, what, "Give the .npy, .tiff or .h5 of what it shows.")
    samples = _decode(path, data, header)
    values, notes = _colours(path, data, header, samples)
    stated = statement_of(lambda: _encoding(data, header))
    exif = _EXIF[header.kind](data) if header.kind in _EXIF else None
    bits = values.dtype.itemsize * 8 if header.bits is None else max(header.bits, 8)
    white = None if values.dtype.kind == "f" else float(2**bits - 1)
    return StoredPicture(
        values=values,
        white=white,
        encoding=stated.encoding,
        encoding_source=stated.source,
        encoding_refusal=stated.refusal,
        orientation=_orientation(data, header, exif),
        exif=exif,
        is_lossy=header.is_lossy is not False,
        kind=header.kind if header.bits in (None, 8) else f"{header.bits}-bit {header.kind}",
        notes=(*notes, *stated.notes, *_further_pictures(data, header)),
    )


def _decode(path: Path, data: bytes, header: Header) -> Samples:
    """Decode samples; raise UserError if that fails, or they haven't the size of the header."""
    try:
        found = _DECODERS[header.kind](data)
    except MemoryError as error:
        raise refuse_picture(
            path, f"a {header.kind} for which there is too little memory"
        ) from error
    # Each decoder has an exception of its own.
    except Exception as error:
        reason = " ".join(str(error).split())[:120]
        raise refuse_picture(
            path, f"a {header.kind} that is damaged, cut short or of a rare kind ({reason})"
        ) from error
    if found.ndim not in (2, 3) or found.shape[:2] != (header.height, header.width):
        raise refuse_picture(
            path, f"a {header.kind} that was decoded to {' x '.join(map(str, found.shape))}, and "
            f"is {header.height} x {header.width} by its header"
        )  # fmt: skip
    if header.kind == "JPEG" and len(found) > _BLOCK and (found[-_BLOCK:] == found[-1]).all():
        _require_sound_jpeg(path, data)
    return found


def _require_sound_jpeg(path: Path, data: bytes) -> None:
    """Raise UserError for a JPEG of fewer rows than its header says, as only OpenCV tells."""
    import cv2

    with collect_library_text(_LIBRARY_TEXT) as said:
        cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_REDUCED_GRAYSCALE_8)
    if any("premature end" in line.lower() for line in said):
        what = "a JPEG that is damaged: it has fewer rows than its header says"
        raise refuse_picture(path, what, "Get the original.")


def _colours(
    path: Path, data: bytes, header: Header, samples: Samples
) -> tuple[Samples, tuple[str, ...]]:
    """Return samples as (1 or 3, rows, columns), and what was done with others."""
    bands = samples[None] if samples.ndim == 2 else np.moveaxis(samples, -1, 0)
    if header.kind == "JPEG" and len(bands) == 4:
        # Adobe's files store 255 for no ink.
        paper = bands if b"Adobe" in data[:4096] else 255 - bands
        return inks_to_colours(paper, 255), (INKS_TURNED,)
    if len(bands) in (1, 3) and header.kind == "PNG" and b"tRNS" in data[:_HEAD]:
        return bands, (ALPHA_LEFT_OUT,)
    if header.kind == "GIF" and len(bands) == 4:
        raise refuse_picture(path, "a GIF with transparent pixels, which have no colour")
    if len(bands) in (2, 4):
        return bands[:-1], (ALPHA_LEFT_OUT,)
    if len(bands) not in (1, 3):
        raise refuse_picture(path, f"a {header.kind} of {len(bands)} bands a pixel")
    return bands, ()


def _further_pictures(data: bytes, header: Header) -> tuple[str, ...]:
    """Say in words what else a file holds, such as a gain map or further frames."""
    head = data[:_HEAD]
    if header.kind == "JPEG" and (b"hdrgm" in head or b"21496-1" in head):
        return ("its gain map for brighter screens was left out",)
    if header.kind == "JPEG" and b"MPF\0" in head:
        return ("it holds two pictures or more (MPO), of which the first was read",)
    if header.kind in _MOVES and _MOVES[header.kind](data):
        return ("it is an animation, of which the first picture was read",)
    return ()


_HEAD = 1 << 16
"""Bytes at a file's beginning that are searched for names of its parts. Chosen: a JPEG's segment
has at most these."""

_MOVES: dict[str, Callable[[bytes], bool]] = {
    "PNG": lambda data: b"acTL" in data[:_HEAD],
    "WebP": lambda data: any(name == b"ANMF" for name, _ in riff_chunks(data)),
    "GIF": lambda data: count_gif_frames(data) > 1,
    "AVIF": lambda data: data[8:12] == b"avis",
}
"""Whether a file of each format is an animation."""


def _encoding(data: bytes, header: Header) -> Statement:
    """Return the encoding that a file states, with remarks."""
    if header.kind == "PNG":
        return png_encoding(data)
    if header.kind == "AVIF":
        return heif_encoding(data)
    read = {"JPEG": icc_of_jpeg, "WebP": icc_of_webp}.get(header.kind)
    profile = read(data) if read is not None else None
    return Statement(None) if profile is None else icc_encoding(profile)


_EXIF = {
    "JPEG": exif_of_jpeg,
    "PNG": exif_of_png,
    "WebP": exif_of_webp,
    "AVIF": exif_of_heif,
    "JPEG XL": exif_of_jpeg_xl,
}
"""What finds the Exif block in a file of each format."""


def _orientation(data: bytes, header: Header, exif: Exif | None) -> int:
    """Return the orientation that a file states, 1 to 8."""
    if header.kind == "AVIF":
        return orientation_of_heif(data)
    if header.kind == "JPEG XL":
        found = read_jpeg_xl_header(data)
        return found.orientation if found is not None else 1
    return (exif.orientation if exif is not None else None) or 1
