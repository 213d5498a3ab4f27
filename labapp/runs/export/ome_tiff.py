"""Export frames as one OME-TIFF file, for microscopy programs."""

from __future__ import annotations

import errno
import math
import os
import shutil
import struct
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.runs.export.export_job import ExportJob
from labapp.runs.export.ome import ome_xml
from labapp.runs.export.single_files import tiff_tags

_TIFF_LIMIT = 2**32 - 2**25
"""Largest size in bytes of a TIFF file's pictures and description, with 32 MiB left for its
directories of pages. Larger exports are written as BigTIFF."""

_TIFF_PAGES = 1 << 16
"""Pages whose directories take less than that. Chosen."""

_PAGES_AT_ONCE = 1 << 10
"""Pages whose directories are in memory at once: some hundred kilobytes. Chosen."""

_DESCRIPTION = 270
"""Tag of a page's description: TIFF 6.0, section 8."""

_PLACEHOLDER = "OME-XML follows the pictures"
"""Stands for the description until it is written. Chosen: too long to be kept in the tag itself."""


def write_ome_tiff(work: ExportJob, draft: Path) -> None:
    """Write the frames as one OME-TIFF file.

    The description of a million frames is as large as small frames are, so that it is written part
    by part, and comes last in the file.
    """
    import tifffile

    path = draft / work.first_name
    described = path.with_suffix(".xml")
    with described.open("w", encoding="ascii") as text:
        text.writelines(ome_xml(work))
    count = len(work.frames)
    size = 2 * count * math.prod(work.shape) + described.stat().st_size
    is_big = size > _TIFF_LIMIT or count > _TIFF_PAGES
    images = work.images()
    with tifffile.TiffWriter(path, byteorder="<", bigtiff=is_big, ome=False) as file:
        for first in range(0, count, _PAGES_AT_ONCE):
            pages = min(_PAGES_AT_ONCE, count - first)
            file.write(
                _some(images, pages),
                shape=(pages, *work.shape),
                dtype=np.uint16,
                photometric="minisblack",
                contiguous=False,
                **tiff_tags(work, "" if first else _PLACEHOLDER),
            )
    try:
        with tifffile.TiffFile(path) as written:
            at = written.pages.first.tags[_DESCRIPTION].offset
    except tifffile.TiffFileError as error:
        # It has just been written; tifffile hides why it can't be read.
        reason = f"{os.strerror(errno.EIO)}: it doesn't read back as it was written"
        raise OSError(errno.EIO, reason) from error
    _append_description(path, described, at, is_big)
    described.unlink()


def _some(images: Iterator[NDArray[np.uint16]], count: int) -> Iterator[NDArray[np.uint16]]:
    return islice(images, count)


def _append_description(path: Path, described: Path, tag: int, is_big: bool) -> None:
    """Append a text to a TIFF file, and let the tag at a position tell where it is.

    A tag has number, type, count and offset: TIFF 6.0, section 2; counts and offsets have 8 bytes
    in BigTIFF.
    """
    with path.open("r+b") as file, described.open("rb") as text:
        begin = file.seek(0, os.SEEK_END)
        begin += file.write(b"\0" * (begin % 2))
        shutil.copyfileobj(text, file, 1 << 20)
        length = file.tell() - begin + file.write(b"\0")
        file.seek(tag + 4)
        file.write(struct.pack("<QQ" if is_big else "<II", length, begin))
