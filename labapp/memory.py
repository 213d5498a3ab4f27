"""How the process deals with memory that it has done with."""

from __future__ import annotations

import ctypes

_TRIM_THRESHOLD, _MMAP_MAX = -1, -4
"""Of glibc's mallopt()."""

_KEPT = (1 << 31) - 1


def keep_freed_memory() -> None:
    """Have large arrays take the memory of those before them.

    glibc would give each back to the system, which clears every page of the next one: pictures of
    some megapixels were measured to take two to three times as long. Other C libraries have their
    own ways, and are left alone.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_TRIM_THRESHOLD, _KEPT)
        mallopt(_MMAP_MAX, 0)
