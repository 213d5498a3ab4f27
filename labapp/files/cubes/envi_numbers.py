"""Read windows of the numbers of an ENVI file, without holding more of the file than a piece.

Numbers lie along three axes, whose order is the interleave: in bsq bands, lines, samples; in bil
lines, bands, samples; in bip lines, samples, bands. A window is read in pieces that lie together in
the file: some of the middle axis and all of the last, at one place of the first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.cubes.envi_header import INTERLEAVES, EnviHeader
from labapp.files.cubes.stored_values import MOST_CUBE_BYTES, Values, Window
from labapp.files.guarded_reading import open_regular

_PIECE = 1 << 20
"""Bytes of the file that are read at once, 1 MiB. Chosen: smaller ones take more time."""

_ROUNDED_NUMBER, _ROUNDING = 1e30, 1e-5
"""Number from which on one that stands for a missing value is compared with this relative
tolerance: headers state single precision's largest, 3.4028235e38, with six digits or fewer."""


@dataclass(frozen=True)
class _Piece:
    """Numbers that lie together in the file, of which a window has some.

    place: index in the window, its axes in the file's order.
    numbers: as they are stored.
    bands: of the file, along one axis of the numbers, or one for all.
    """

    place: tuple[int, Any]
    numbers: NDArray[Any]
    bands: NDArray[np.intp]


@dataclass(frozen=True)
class EnviNumbers:
    """The numbers of an ENVI file, of which windows are read; the header scales them."""

    path: Path
    header: EnviHeader

    def read_window(self, window: Window) -> Values:
        """Read and scale a window, (bands, rows, columns); NaN stands for missing values.

        The bands are those of the cube, by rising wavelength. Raises UserError if the file is cut
        short, or if single precision takes its numbers for 0.
        """
        bands, rows, columns = window
        made = np.empty((len(bands), len(rows), len(columns)), np.float32)
        in_file_order = made.transpose(["blr".index(axis) for axis in self._axes])
        stored_bands = [self.header.order[band] for band in bands]
        has_light = vanishes = False
        with (
            open_regular(self.path, MOST_CUBE_BYTES) as file,
            np.errstate(over="ignore", invalid="ignore"),
        ):
            for piece in self._pieces(file, (stored_bands, rows, columns)):
                scaled = self._scale(piece)
                single = scaled.astype(np.float32)
                single[self._is_missing(piece.numbers)] = np.nan
                in_file_order[piece.place] = single
                has_light = has_light or bool(single.any())
                vanishes = vanishes or (not has_light and bool(scaled.any()))
        if vanishes and not has_light:
            raise UserError(
                f"{self.path}: has numbers that single precision takes for 0. Multiply them by a "
                "power of ten."
            )
        return made

    @property
    def _axes(self) -> str:
        """Axes in the file, the slowest first."""
        return INTERLEAVES[self.header.interleave]

    def _pieces(self, file: BufferedReader, window: Window) -> Iterator[_Piece]:
        """Yield the pieces of a window, whose bands are the file's."""
        sizes = dict(zip("blr", self.header.shape, strict=True))
        wanted = dict(zip("blr", window, strict=True))
        length, bands = sizes[self._axes[2]], np.asarray(wanted["b"])
        runs = _runs(
            wanted[self._axes[1]], max(_PIECE // (length * self.header.number_type.itemsize), 1)
        )
        last = _as_slice(wanted[self._axes[2]])
        for at, first in enumerate(wanted[self._axes[0]]):
            for places, run in runs:
                stored = self._read(
                    file, first * sizes[self._axes[1]] + run.start, len(run), length
                )
                # The bands along the axis that is theirs.
                of_bands = (at, (places, None), slice(None))[self._axes.index("b")]
                yield _Piece((at, places), stored[:, last], bands[of_bands])

    def _read(self, file: BufferedReader, line: int, lines: int, length: int) -> NDArray[Any]:
        """Read lines of numbers that lie together, (lines, length)."""
        kind = self.header.number_type
        file.seek(self.header.offset + line * length * kind.itemsize)
        data = file.read(lines * length * kind.itemsize)
        if len(data) < lines * length * kind.itemsize:
            raise UserError(f"{self.path}: is cut short. Copy the file again.")
        return np.frombuffer(data, kind).reshape(lines, length)

    def _scale(self, piece: _Piece) -> NDArray[Any]:
        """Convert stored numbers by the gains and offsets of their bands."""
        gains, offsets = (np.array(one) for one in (self.header.gains, self.header.offsets))
        if (gains == 1).all() and not offsets.any():
            return piece.numbers
        return piece.numbers * gains[piece.bands] + offsets[piece.bands]

    def _is_missing(self, stored: NDArray[Any]) -> NDArray[np.bool_]:
        """Return which stored numbers stand for a missing value."""
        ignored = self.header.ignored
        if ignored is None or math.isnan(ignored):
            return np.zeros(stored.shape, np.bool_)
        if stored.dtype.kind != "f":
            return np.asarray(stored == ignored)
        exact = stored.dtype.type(ignored)
        if abs(ignored) < _ROUNDED_NUMBER:
            return np.asarray(stored == exact)
        return np.asarray(np.abs(stored / exact - 1) < _ROUNDING)


def _runs(wanted: Sequence[int], most: int) -> list[tuple[Any, range]]:
    """Divide places on an axis into runs of neighbours, of at most some places each.

    Each has the index of its places among those that are wanted, and the run in the file.
    """
    order = np.argsort(wanted, kind="stable")
    found, begin = [], 0
    for k in range(1, len(order) + 1):
        is_end = k == len(order) or wanted[order[k]] != wanted[order[k - 1]] + 1
        if is_end or k - begin == most:
            first = wanted[order[begin]]
            found.append((_as_slice(order[begin:k].tolist()), range(first, first + k - begin)))
            begin = k
    return found


def _as_slice(places: Sequence[int]) -> Any:
    """Return an index of places on an axis: a slice where they follow each other."""
    first = places[0]
    neighbours = list(places) == list(range(first, first + len(places)))
    return slice(first, first + len(places)) if neighbours else list(places)
