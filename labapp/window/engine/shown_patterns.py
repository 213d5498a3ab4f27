"""The patterns that were shown, kept for undo and redo."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.window.settings_history import DEPTH

_KEPT = DEPTH + 1
"""Patterns that are kept: the undo of every change needs the one before the first."""

_FASTEST = 1
"""Level of zlib's compression. A panel of 1920 x 1080 takes some 20 ms, and 2 MB at most."""


@dataclass(frozen=True)
class _PackedPattern:
    name: str
    shape: tuple[int, ...]
    data: bytes


class ShownPatterns:
    """Keep the grey levels of patterns as they were shown, by numbers that count them.

    A pattern from a file is kept as it was, even if its file has changed since. Number 0 is the
    one at the opening of the bench, given by `name` and `grey`.
    """

    def __init__(self, name: str, grey: NDArray[np.uint8]) -> None:
        self._packed: dict[int, _PackedPattern] = {}
        self._count = 0
        self.keep(name, grey)

    def keep(self, name: str, grey: NDArray[np.uint8]) -> int:
        """Keep a pattern, and return its number: the last one's if it is the same."""
        packed = _PackedPattern(name, grey.shape, zlib.compress(grey.tobytes(), _FASTEST))
        if self._packed.get(self._count - 1) == packed:
            return self._count - 1
        number, self._count = self._count, self._count + 1
        self._packed[number] = packed
        self._packed.pop(number - _KEPT, None)
        return number

    def pattern(self, number: int) -> tuple[str, NDArray[np.uint8]]:
        """Return a pattern's name and grey levels; UserError if it isn't kept any more."""
        packed = self._packed.get(number)
        if packed is None:
            raise UserError("That pattern isn't kept any more. Choose it again.")
        grey = np.frombuffer(zlib.decompress(packed.data), np.uint8).reshape(packed.shape)
        return packed.name, grey.copy()
