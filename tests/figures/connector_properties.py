"""Properties of a virtual screen's connector, made and set by libXrandr as graphics drivers do."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes import POINTER, c_char_p, c_int, c_long, c_ulong, c_void_p

Value = str | Sequence[int]

_ATOM, _INTEGER = 4, 19
"""XA_ATOM and XA_INTEGER of Xatom.h."""


class Connector:
    """An output of an X server whose properties are made and set by another program.

    number: the server's number of the output.
    """

    def __init__(self, display: str, number: int) -> None:
        self._x11, self._randr = _load("libX11.so.6"), _load("libXrandr.so.2")
        self._display = self._x11.XOpenDisplay(display.encode())
        self._number = number
        self._made: set[str] = set()
        if not self._display:
            raise OSError(f"no X server answers at {display}")

    def make(
        self, name: str, valid: Sequence[str | int], value: Value, *, is_range: bool = False
    ) -> None:
        """Make a property with its allowed values, and set it."""
        known = [self._atom(one) if isinstance(one, str) else one for one in valid]
        self._randr.XRRConfigureOutputProperty(
            self._display,
            self._number,
            self._atom(name),
            0,
            int(is_range),
            len(known),
            (c_long * max(1, len(known)))(*known),
        )
        self._made.add(name)
        self.set(name, value)

    def set(self, name: str, value: Value) -> None:
        """Set a property; on return, the server has done it."""
        kind = _ATOM if isinstance(value, str) else _INTEGER
        items = [self._atom(value)] if isinstance(value, str) else list(value)
        self._randr.XRRChangeOutputProperty(
            self._display,
            self._number,
            self._atom(name),
            kind,
            32,
            0,
            (c_long * len(items))(*items),
            len(items),
        )
        self._x11.XSync(self._display, 0)

    def delete(self, name: str) -> None:
        self._made.remove(name)
        self._randr.XRRDeleteOutputProperty(self._display, self._number, self._atom(name))
        self._x11.XSync(self._display, 0)

    def close(self) -> None:
        """Delete what was made, and disconnect."""
        for name in [*self._made]:
            self.delete(name)
        self._x11.XCloseDisplay(self._display)

    def _atom(self, name: str) -> int:
        return int(self._x11.XInternAtom(self._display, name.encode(), 0))


@contextmanager
def connector(display: str, number: int) -> Iterator[Connector]:
    """A connector of an X server, while the block lasts."""
    made = Connector(display, number)
    try:
        yield made
    finally:
        made.close()


def _load(name: str) -> ctypes.CDLL:
    library = ctypes.CDLL(name)
    for function, result, given in (
        ("XOpenDisplay", c_void_p, (c_char_p,)),
        ("XCloseDisplay", c_int, (c_void_p,)),
        ("XInternAtom", c_ulong, (c_void_p, c_char_p, c_int)),
        ("XSync", c_int, (c_void_p, c_int)),
        (
            "XRRConfigureOutputProperty",
            None,
            (c_void_p, c_ulong, c_ulong, c_int, c_int, c_int, POINTER(c_long)),
        ),
        (
            "XRRChangeOutputProperty",
            None,
            (c_void_p, c_ulong, c_ulong, c_ulong, c_int, c_int, c_void_p, c_int),
        ),
        ("XRRDeleteOutputProperty", None, (c_void_p, c_ulong, c_ulong)),
    ):
        if hasattr(library, function):
            found = getattr(library, function)
            found.restype, found.argtypes = result, given
    return library
