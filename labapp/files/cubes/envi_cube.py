"""Spectral cubes in ENVI's format, which most programs for spectral pictures read.

Numbers lie along three axes, whose order is the interleave: in bsq bands, lines, samples; in bil
lines, bands, samples; in bip lines, samples, bands. A window is read in pieces that lie together in
the file: some of the middle axis and all of the last, at one place of the first.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.cubes.cube import SpectralCube
from labapp.files.cubes.envi_header import INTERLEAVES, EnviHeader, parse_header
from labapp.files.cubes.stored_values import (
    MOST_CUBE_BYTES,
    StoredValues,
    Values,
    Window,
    file_state,
)
from labapp.files.guarded_reading import MOST_TEXT_BYTES, is_file, open_regular, read_bytes
from labapp.files.text_encoding import decode_text

_DATA_ENDINGS = (
    ".raw", ".img", ".dat", ".bsq", ".bil", ".bip", ".fla", ".bin", ".hyspex", "",
)  # fmt: skip
"""Endings of the file beside a header that holds the numbers, in the order of looking for it."""

_UNKNOWN_UNIT = "numbers of the file"
"""Unit of a cube whose header states none."""


def encode_envi(cube: SpectralCube) -> tuple[bytes, bytes]:
    """Return the bytes of the two ENVI files: the header, and the numbers.

    The numbers are float32, band by band (BSQ), least significant byte first. The error map isn't
    written.
    """
    bands, rows, columns = cube.shape
    keys = {
        "description": _in_braces(cube.description or "Spectral cube written by labapp"),
        "file type": "ENVI Standard",
        "samples": str(columns),
        "lines": str(rows),
        "bands": str(bands),
        "header offset": "0",
        "data type": "4",
        "interleave": "bsq",
        "byte order": "0",
        "wavelength units": "Nanometers",
        "wavelength": _in_braces(", ".join(f"{one * 1e9:.6f}" for one in cube.wavelengths)),
        "band names": _in_braces(", ".join(f"{one * 1e9:g} nm" for one in cube.wavelengths)),
        "data units": _in_braces(cube.unit),
    }
    if cube.light:
        keys["light"] = _in_braces(cube.light)
    if cube.pitch is not None:
        keys["pixel size"] = _in_braces(f"{cube.pitch:.9g}, {cube.pitch:.9g}, units=Meters")
    if cube.missing.any():
        keys["data ignore value"] = "NaN"
    header = "ENVI\n" + "".join(f"{key} = {value}\n" for key, value in keys.items())
    return header.encode(), np.asarray(cube.values, "<f4").tobytes()


def read_envi(header_path: Path) -> SpectralCube:
    """Read an ENVI header; the numbers are read when they're used.

    Raises UserError if a file is missing, or doesn't hold what the header says.
    """
    # The format prescribes ASCII; a degree sign of some other encoding in a comment does no harm.
    data = read_bytes(header_path, MOST_TEXT_BYTES)
    header = parse_header(decode_text(data) or data.decode(errors="replace"))
    path = _find_data(header_path, header)
    shape = (len(header.order), *header.shape[1:])
    return SpectralCube(
        StoredValues(path, shape, EnviNumbers(path, header).read_window),
        header.wavelengths,
        header.unit or _UNKNOWN_UNIT,
        None,
        header.light,
        header.pitch,
        header.description,
        notes=tuple(f"{header_path.name}: {note}" for note in header.notes),
    )


def _in_braces(text: str) -> str:
    """Return a text as a header's value, on one line and without braces of its own."""
    return "{" + " ".join(re.sub(r"[{}]", "", text).split()) + "}"


def _find_data(path: Path, header: EnviHeader) -> Path:
    """Return the file with the numbers beside a header; UserError if there isn't one."""
    stem = path.with_suffix("")
    beside = {one.name.lower(): one for one in path.parent.iterdir() if is_file(one)}
    named = (beside.get(f"{stem.name}{ending}".lower()) for ending in _DATA_ENDINGS)
    found = [one for one in named if one is not None and one != path]
    if not found:
        raise UserError(
            f"{path}: the numbers aren't beside it. Put {stem.name}.raw there, or with another of "
            f"the endings {', '.join(filter(None, _DATA_ENDINGS))}"
        )
    sizes = {one: file_state(one)[0] for one in found}
    fitting = [one for one, size in sizes.items() if size == header.size]
    if not fitting:
        bands, rows, columns = header.shape
        raise UserError(
            f"{found[0]}: has {sizes[found[0]]} bytes, and by its header {header.size}: {bands} "
            f"bands, {rows} lines and {columns} samples of type {header.number_type.name}, after "
            f"{header.offset} bytes. Correct the header, or copy the file again"
        )
    if len(fitting) > 1:
        raise UserError(
            f"{path}: the numbers may be in {' or '.join(one.name for one in fitting)}, which have "
            "the right size. Give one of them another name"
        )
    return fitting[0]


_PIECE = 1 << 20
"""Bytes of the file that are read at once, 1 MiB. Chosen: smaller ones take more time."""

_ROUNDED_NUMBER, _ROUNDING = 1e30, 1e-5
"""Number from which on one that stands for a missing value is compared with this relative
tolerance: headers state single precision's largest, 3.4028235e38, with six digits or fewer."""


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
        gains, offsets = np.array(self.header.gains), np.array(self.header.offsets)
        has_light = vanishes = False
        with (
            open_regular(self.path, MOST_CUBE_BYTES) as file,
            np.errstate(over="ignore", invalid="ignore"),
        ):
            for place, stored, of_bands in self._pieces(file, (stored_bands, rows, columns)):
                scaled = stored
                if (gains != 1).any() or offsets.any():
                    scaled = stored * gains[of_bands] + offsets[of_bands]
                single = scaled.astype(np.float32)
                single[self._is_missing(stored)] = np.nan
                in_file_order[place] = single
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

    def _pieces(
        self, file: BufferedReader, window: Window
    ) -> Iterator[tuple[tuple[int, Any], NDArray[Any], NDArray[np.intp]]]:
        """Yield numbers that lie together in the file, of which a window, by its bands, has some.

        Each has its index in the window, whose axes are in the file's order, and the bands along
        one axis of the numbers, or one for all.
        """
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
                yield (at, places), stored[:, last], bands[of_bands]

    def _read(self, file: BufferedReader, line: int, lines: int, length: int) -> NDArray[Any]:
        """Read lines of numbers that lie together, (lines, length)."""
        kind = self.header.number_type
        file.seek(self.header.offset + line * length * kind.itemsize)
        data = file.read(lines * length * kind.itemsize)
        if len(data) < lines * length * kind.itemsize:
            raise UserError(f"{self.path}: is cut short. Copy the file again.")
        return np.frombuffer(data, kind).reshape(lines, length)

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
