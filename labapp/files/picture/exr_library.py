"""OpenEXR by its own library, which is kept from the terminal.

The library prints what it thinks of damaged files, and then leaves parts out without an error. What
it says is taken away here, and is the error.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.library_text import collect_library_text

_SAID = re.compile(rb"[^\n]*\(EXR_ERR_\w+\)[^\n]*\n?|Warning: Exception raised reading[^\n]*\n?")
"""Lines that the library prints of damaged files."""


def open_exr(path: Path, data: bytes, header_only: bool) -> list[Any]:
    """Return a file's parts as the library reads them; UserError if it finds damage."""
    import OpenEXR

    with collect_library_text(_SAID) as said:
        try:
            file = OpenEXR.File(io.BytesIO(data), separate_channels=True, header_only=header_only)
            parts = list(file.parts)
        # Damage also leads to texts that aren't UTF-8, and to sizes that no memory holds.
        except (RuntimeError, ValueError, TypeError, MemoryError, OSError) as error:
            raise damaged_exr(path) from error
    if said or not parts:
        raise damaged_exr(path)
    return parts


def encode_open_exr(light: NDArray[np.float32]) -> bytes:
    """Return the bytes of light as OpenEXR, (1 or 3, rows, columns), exact in float32.

    One band is written as luminance (Y), three as R, G and B with the primaries of sRGB.
    """
    import OpenEXR

    names = ("R", "G", "B") if len(light) == 3 else ("Y",)
    channels = {
        name: OpenEXR.Channel(np.ascontiguousarray(band, dtype=np.float32))
        for name, band in zip(names, light, strict=True)
    }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    file = io.BytesIO()
    OpenEXR.File(header, channels).write(file)
    return file.getvalue()


def damaged_exr(path: Path) -> UserError:
    """Return the error that says that an OpenEXR file is damaged."""
    return UserError(f"{path}: is a damaged or incomplete OpenEXR file. Get it again.")
