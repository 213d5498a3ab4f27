"""What happens where memory lacks: errors are told in words, and large libraries are refused.

A lack is told from the errors of many libraries. A large library isn't loaded where its memory
isn't there: many abort the process half-way.
"""

from __future__ import annotations

import errno
import mmap
import re
import resource
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import PathFinder
from typing import Any

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


_NEEDS = {
    "numpy": (120, 78),
    "torch": (500, 135),
    "cv2": (265, 90),
    "scipy.linalg": (120, 82),
    "scipy.special": (120, 82),
    "matplotlib": (50, 30),
    "colour": (60, 45),
    "PySide6": (110, 20),
}
"""Addresses and data in megabytes that libraries take when they are loaded one after the other,
with the 32 MB of each OpenBLAS: differences of VmSize and VmData of /proc/self/status, measured on
Linux."""

_RESERVE = 6 << 20
"""Bytes that are given back where memory lacks, for the words about it. Chosen."""


class LibraryGuard:
    """A finder of Python's imports that refuses a library that doesn't fit into a limit."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: Any = None) -> Any:
        """Return what loads a library, or None for Python's own finders to look for it.

        Raises MemoryError before a large library is loaded where a limit leaves too little.
        """
        if name in _NEEDS:
            _require_room(name)
        spec = PathFinder.find_spec(name, path) if name in _FIRST_SUMS else None
        if spec is None or spec.loader is None:
            return None
        load = spec.loader.exec_module

        def load_and_compute(module: Any) -> None:
            load(module)
            _FIRST_SUMS[name](module)

        spec.loader.exec_module = load_and_compute  # type: ignore[method-assign]
        return spec


_FIRST_SUMS: dict[str, Callable[[Any], Any]] = {
    "numpy": lambda numpy: numpy.ones((64, 64)) @ numpy.ones((64, 64)),
    "scipy.linalg": lambda linalg: linalg.inv(2 * linalg.hadamard(64)),
}
"""Sums for which the two OpenBLAS take their 32 MB, as soon as they are there: OpenBLAS ends the
process where it doesn't get them (memory.c of its releases, "giving up")."""


_TWINS = "scipy.linalg", "scipy.special"
"""Modules that load SciPy's OpenBLAS, whichever comes first; it never ends to try where it doesn't
fit."""


def _require_room(name: str) -> None:
    """Raise MemoryError if a limit leaves less than a large library takes."""
    if name in _TWINS and any(one in sys.modules for one in _TWINS):
        return
    for limit in process_limits():
        need = _NEEDS[name][0 if limit.setting == "ulimit -v" else 1] * 10**6
        if limit.left < need:
            raise MemoryError(
                f"the library {name} needs about {need / 1e6:,.0f} MB, of which "
                f"{limit.left / 1e6:,.0f} MB are left"
            )


def guard_library_memory() -> None:
    """From now on, refuse to load large libraries where a limit leaves too little."""
    guarded = any(isinstance(one, LibraryGuard) for one in sys.meta_path)
    if not guarded and any(True for _ in process_limits()):
        sys.meta_path.insert(0, LibraryGuard())


@contextmanager
def reserved_memory() -> Iterator[None]:
    """Keep memory back for the words about a lack of it, while a block runs.

    Its pages are never touched, so that it takes addresses alone. Raises MemoryError if there is
    too little of it already.
    """
    try:
        reserve = mmap.mmap(-1, _RESERVE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:
        raise MemoryError from error
    with reserve:
        yield
