"""Tells a lack of memory from the errors of many libraries: what needs how much, and the remedy."""

from __future__ import annotations

import errno
import re
import resource
from collections.abc import Iterator

from labapp.common.free_memory import process_limits, shared_memory

_WORDS = re.compile(
    r"can't allocate memory|not enough memory|out of memory|Insufficient memory|bad_alloc"
    r"|[Mm]emory allocation failed|[Ff]ailed to allocate|[Uu]nable to allocate"
    r"|[Cc]annot allocate memory|can't start new thread|failed to map segment"
    r"|without exception set|without setting an exception",
)
"""Words of errors that NumPy, torch, OpenCV, HDF5, Python and the system's loader raise where
memory lacks; only NumPy's is a MemoryError."""

_SIZE = re.compile(
    r"(?:allocate|Failed to allocate)\s+(\d+(?:\.\d*)?)\s*(bytes|[KMGTPE]i?B)(?: for (an array.*))?"
)

_LIBRARY = re.compile(r"([\w.+-]+\.so[\w.]*): (?:failed to map|cannot allocate)")

_REMEDY = (
    "Ask for fewer pixels or samples, check the units of lengths, raise the limit of memory, or "
    "close other programs."
)

_USUAL_STACK = 8 << 20

_TIGHT = 100_000_000
"""Bytes left of a limit, with which a library that doesn't load lacks memory. Chosen."""


def explain_shortage(error: BaseException) -> str:
    """Say what lacks how much memory; "" for an error of another kind.

    A lack that is the cause of another error counts, too.
    """
    for one in _causes(error):
        if _is_shortage(one):
            return f"there isn't enough memory: {_need(one)}, and {describe_room()}. {_REMEDY}"
    return ""


def describe_room() -> str:
    """Say how much memory the process may take in all, by what limits it most."""
    limits = sorted(process_limits(), key=lambda one: one.left)
    if limits and limits[0].left <= shared_memory():
        return f"this process may take {_megabytes(limits[0].most)} in all ({limits[0].setting})"
    return f"{_megabytes(shared_memory())} of the machine's memory are free"


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and what caused it, or was being dealt with, one after the other."""
    for _ in range(10):
        if error is None:
            return
        yield error
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)


def _is_shortage(error: BaseException) -> bool:
    if isinstance(error, MemoryError):
        return True
    if isinstance(error, OSError) and error.errno is not None:
        # A process that may not be forked is refused with EAGAIN, which names no file.
        return error.errno == errno.ENOMEM or (error.errno == errno.EAGAIN and not error.filename)
    if isinstance(error, ImportError) and any(one.left < _TIGHT for one in process_limits()):
        # Packages that load libraries by themselves say that these aren't installed.
        return True
    # What OpenCV raises has a code for it, and stands on Exception alone.
    known = isinstance(error, RuntimeError | ImportError | OSError | SystemError)
    is_opencv = type(error).__module__ == "cv2"
    return (known or is_opencv) and bool(_WORDS.search(str(error)))


def _need(error: BaseException) -> str:
    """Say what needed memory, and how much as far as its error tells."""
    text = " ".join(str(error).split())
    if "needs about" in text:
        return text
    if "start new thread" in text:
        stack = resource.getrlimit(resource.RLIMIT_STACK)[0]
        size = _USUAL_STACK if stack == resource.RLIM_INFINITY else stack
        return f"a thread needs {_megabytes(size)}"
    if found := _LIBRARY.search(text):
        return f"the library {found[1]} needs more than is left"
    if found := _SIZE.search(text):
        number, unit, what = found.groups()
        amount = _megabytes(float(number)) if unit == "bytes" else f"{number.rstrip('.')} {unit}"
        return f"{what or 'an array'} needs {amount}"
    if isinstance(error, ImportError):
        return "a library needs more than is left"
    if isinstance(error, OSError):
        return "a process or a file's memory needs more than is left"
    return "a step of the computation needs more than is left"


def _megabytes(size: float) -> str:
    return f"{size / 1e6:,.0f} MB" if size >= 1e7 else f"{size / 1e6:,.3g} MB"
