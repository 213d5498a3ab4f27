"""How the process deals with memory that it has done with."""

from __future__ import annotations

import ctypes

_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8
"""Of glibc's mallopt()."""

_KEPT_BYTES = (1 << 31) - 1


def keep_freed_memory() -> None:
    """Have large arrays take the memory of those before them.

    glibc would give each back to the system, which clears every page of the next one: pictures of
    some megapixels were measured to take two to three times as long. Other C libraries have their
    own ways, and are left alone. All threads share one heap, so that what one has freed serves
    the others; glibc doesn't give the end of a thread's own heap back either.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)
        mallopt(_MMAP_MAX, 0)
        mallopt(_ARENA_MAX, 1)


def give_back_freed_memory() -> None:
    """Give the system back what was freed, when a bench has closed and nothing follows soon.

    glibc keeps hundreds of megabytes of it otherwise, below the last thing that stays.
    """
    malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if malloc_trim is not None:
        malloc_trim(0)
