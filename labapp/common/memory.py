"""Whether the process keeps freed memory or returns it to the operating system."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Iterator
from contextlib import contextmanager

_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8
"""Parameters of glibc's mallopt()."""

_KEPT_BYTES = (1 << 31) - 1
"""Free bytes above which glibc trims the heap: the largest number that mallopt() takes."""


def keep_freed_memory() -> None:
    """Let new large arrays reuse the memory of freed ones.

    By default, glibc returns it to the system, which clears every page of the next array: work on
    pictures of some megapixels was measured to take two to three times as long. Other C libraries
    are left as they are. All threads share one heap, so that memory freed by one thread serves
    the others; glibc doesn't return the end of a thread's own heap either.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)
        mallopt(_MMAP_MAX, 0)
        mallopt(_ARENA_MAX, 1)


def give_back_freed_memory() -> None:
    """Give freed memory back to the system, after a bench was closed.

    Otherwise glibc keeps hundreds of megabytes below the last allocation that is still in use.
    """
    malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if malloc_trim is not None:
        malloc_trim(0)


_NEW_OBJECTS = 20_000
"""New objects after which Python looks for garbage. The interpreter's own 700 took 0.25 s of the
2.2 s in which a run's libraries are imported; 20,000 take 0.05 s."""


def collect_garbage_rarely() -> None:
    """Let Python look for garbage only after many new objects."""
    gc.set_threshold(_NEW_OBJECTS, *gc.get_threshold()[1:])


@contextmanager
def lasting_objects() -> Iterator[None]:
    """Keep Python's garbage collector from all objects that are made within, such as modules.

    Looking through them again and again took a sixth of the time in which a bench's libraries are
    imported, and more at every collection later.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
