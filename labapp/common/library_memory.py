"""Refuses to load a large library where its memory isn't there: many abort the process half-way."""

from __future__ import annotations

import mmap
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import PathFinder
from typing import Any

from labapp.common.free_memory import process_limits

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
