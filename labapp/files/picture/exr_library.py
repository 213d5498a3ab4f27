"""Read and write OpenEXR files by OpenEXR's own library, which is kept from the terminal.

The library prints what it thinks of damaged files, and then leaves parts out without an error. What
it says is taken away here, and is the error.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError

_SAID = re.compile(rb"[^\n]*\(EXR_ERR_\w+\)[^\n]*\n?|Warning: Exception raised reading[^\n]*\n?")
"""Lines that the library prints of damaged files."""

_ONE_AT_A_TIME = threading.Lock()


def open_exr(path: Path, data: bytes, header_only: bool) -> list[Any]:
    """Return the parts of a file as the library reads them; UserError if it finds damage."""
    import OpenEXR

    with _hush() as said:
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
    """Return the bytes of an OpenEXR file of light, (1 or 3, rows, columns), exact in float32.

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


@contextlib.contextmanager
def _hush() -> Iterator[bytearray]:
    """Take away what OpenEXR prints in the block, on standard output and error.

    What it said is in the bytes that are given back, after the block. Other lines go their way.
    """
    said = bytearray()
    out = io.StringIO()
    with _ONE_AT_A_TIME, tempfile.TemporaryFile() as held:
        usual = _redirect_errors(held.fileno())
        try:
            with contextlib.redirect_stdout(out):
                yield said
        finally:
            if usual is not None:
                os.dup2(usual, 2)
                os.close(usual)
            held.seek(0)
            said += _pass_on(held.read(), sys.stderr)
            said += _pass_on(out.getvalue().encode(), sys.stdout)


def _redirect_errors(handle: int) -> int | None:
    """Redirect standard error to a file; return a handle of where it went, None if it is closed."""
    try:
        usual = os.dup(2)
    except OSError:
        return None
    sys.stderr.flush()
    os.dup2(handle, 2)
    return usual


def _pass_on(written: bytes, stream: Any) -> bytes:
    """Write the lines that aren't OpenEXR's to a stream, and return those that are."""
    others = _SAID.sub(b"", written)
    if others and stream is not None:
        stream.write(others.decode(errors="replace"))
    return b"".join(_SAID.findall(written))
