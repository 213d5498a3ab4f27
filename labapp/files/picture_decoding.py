"""Decode picture files with OpenCV, after their headers have been looked at.

A header of a few bytes can ask for a picture of gigabytes, which a decoder allocates before it
finds that there is no such picture.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from labapp.common.errors import UserError
from labapp.files.guarded_reading import MOST_EXPANSION
from labapp.files.picture_size import is_jpeg, picture_size

if TYPE_CHECKING:
    from numpy.typing import NDArray

FREE_PIXELS = 1 << 25
"""Pixels that a picture may have however small its file is, 34 million: more than the cameras of
benches have. Chosen."""

_MOST_SCANS = 100
"""Scans of a progressive JPEG, each of which goes over the whole picture. Encoders write about 10
(ITU-T T.81, section G); a file can hold thousands. Chosen."""

_SCAN = b"\xff\xda"
"""JPEG's marker before each scan."""


def decode_picture(path: Path, data: bytes, flags: int, page: int = 0) -> NDArray[Any] | None:
    """Decode the bytes of a picture file by OpenCV's flags; None if they are no picture.

    `page` selects a picture of a TIFF file. Raises UserError if the picture would be much larger
    than its file.
    """
    import cv2
    import numpy as np

    size = picture_size(data, page)
    if size is None:
        return None
    _require_content(path, data, *size)
    buffer = np.frombuffer(data, dtype=np.uint8)
    try:
        if page == 0:
            return cv2.imdecode(buffer, flags)
        pages = cv2.imdecodemulti(buffer, flags, range=(page, page + 1))[1]
        return pages[0] if pages else None
    except cv2.error:
        return None


def _require_content(path: Path, data: bytes, width: int, height: int) -> None:
    """Raise UserError if a picture file is too small for its picture, or takes too long."""
    if width * height > max(FREE_PIXELS, MOST_EXPANSION * len(data)):
        raise UserError(
            f"{path}: is a picture of {width} x {height} pixels by its header, in {len(data)} "
            "bytes. No photograph is so empty; get the original."
        )
    if is_jpeg(data) and data.count(_SCAN) > _MOST_SCANS:
        raise UserError(
            f"{path}: has more than {_MOST_SCANS} scans, as no program writes. Save it anew."
        )
