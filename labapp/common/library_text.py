"""Catches what libraries write to the terminal by themselves, so that it can be told in words."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator

_ONE_AT_A_TIME = threading.Lock()
"""Standard output and error belong to the whole process."""


@contextlib.contextmanager
def collect_library_text(known: re.Pattern[bytes]) -> Iterator[list[str]]:
    """Collect the lines that a library writes to standard output and error within the block.

    The list has those that match `known` when the block has ended: the pattern's first group, or
    the whole match. Other lines go their way then.
    """
    said: list[str] = []
    out = io.StringIO()
    with _ONE_AT_A_TIME, tempfile.TemporaryFile() as held:
        usual = _redirect_errors(held.fileno())
        try:
            with contextlib.redirect_stdout(out):
                yield said
        finally:
            if usual is not None:
                sys.stderr.flush()
                os.dup2(usual, 2)
                os.close(usual)
            held.seek(0)
            for written, stream in (
                (held.read(), sys.stderr),
                (out.getvalue().encode(), sys.stdout),
            ):
                said += [one[known.groups and 1].decode() for one in known.finditer(written)]
                others = known.sub(b"", written).strip(b"\n")
                # A window has no streams.
                if others and stream is not None:
                    stream.write(others.decode(errors="replace") + "\n")


def _redirect_errors(handle: int) -> int | None:
    """Redirect standard error to a file; return a handle of where it went, None if it is closed."""
    try:
        usual = os.dup(2)
    except OSError:
        # Nothing can come out of it.
        return None
    sys.stderr.flush()
    os.dup2(handle, 2)
    return usual
