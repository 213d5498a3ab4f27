"""Spectral cubes as ENVI files, which most programs for spectral pictures read."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.cubes.cube import SpectralCube
from labapp.files.cubes.envi_header import INTERLEAVES, EnviHeader, format_header, parse_header
from labapp.files.guarded_reading import MOST_TEXT_BYTES, read_bytes

_DATA_ENDINGS = (".raw", ".img", ".dat", ".bsq", ".bil", ".bip", ".fla", ".bin", "")
"""Endings of the file beside a header that holds the numbers, in the order of looking for it."""

_UNKNOWN_UNIT = "numbers of the file"
"""Unit of a cube whose header states none."""


def encode_envi(cube: SpectralCube) -> tuple[bytes, bytes]:
    """Return the bytes of a cube's ENVI files: the header, and the numbers.

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
    return format_header(keys).encode(), cube.values.astype("<f4").tobytes()


def read_envi(header_path: Path) -> SpectralCube:
    """Read a spectral cube from an ENVI header and the numbers beside it.

    Raises UserError if a file is missing, or doesn't hold what the header says.
    """
    # The format prescribes ASCII; a degree sign of some other encoding in a comment does no harm.
    header = parse_header(read_bytes(header_path, MOST_TEXT_BYTES).decode(errors="replace"))
    data_path = _find_data(header_path)
    values = _scale_values(_read_values(data_path, header), header, data_path)
    order = np.argsort(header.wavelengths, kind="stable")
    return SpectralCube(
        values[order].astype(np.float32),
        tuple(header.wavelengths[at] for at in order),
        header.unit or _UNKNOWN_UNIT,
        None,
        header.light,
        header.pitch,
        header.description,
    )


def _in_braces(text: str) -> str:
    """Return a text as the value of an ENVI header, on one line and without braces of its own."""
    return "{" + " ".join(re.sub(r"[{}]", "", text).split()) + "}"


def _find_data(header: Path) -> Path:
    """Return the file with the numbers beside an ENVI header; UserError if there is none."""
    stem = header.with_suffix("")
    beside = {one.name.lower(): one for one in header.parent.iterdir() if one.is_file()}
    for ending in _DATA_ENDINGS:
        found = beside.get(f"{stem.name}{ending}".lower())
        if found is not None and found != header:
            return found
    raise UserError(
        f"{header}: the numbers aren't beside it. Put {stem.name}.raw there, or with another of "
        f"the endings {', '.join(filter(None, _DATA_ENDINGS))}"
    )


def _read_values(path: Path, header: EnviHeader) -> NDArray[np.float64]:
    """Read the numbers of an ENVI file as (bands, rows, columns), as they stand there."""
    data, count = read_bytes(path), math.prod(header.shape)
    wanted = header.offset + count * header.number_type.itemsize
    if len(data) != wanted:
        bands, rows, columns = header.shape
        raise UserError(
            f"{path}: has {len(data)} bytes, and by its header {wanted}: {bands} bands, {rows} "
            f"lines and {columns} samples of type {header.number_type.name}, after "
            f"{header.offset} bytes. Correct the header, or copy the file again"
        )
    numbers = np.frombuffer(data, header.number_type, count, header.offset)
    axes = INTERLEAVES[header.interleave]
    sizes = dict(zip("blr", header.shape, strict=True))
    stored = numbers.reshape([sizes[axis] for axis in axes])
    return stored.transpose([axes.index(axis) for axis in "blr"]).astype(np.float64)


def _scale_values(
    values: NDArray[np.float64], header: EnviHeader, path: Path
) -> NDArray[np.float64]:
    """Convert an ENVI file's numbers by its gains; raise UserError if values are missing."""
    missing = 0 if header.ignored is None else int((values == header.ignored).sum())
    if missing:
        raise UserError(
            f"{path}: has {missing} missing values, {header.ignored:g}. Cut the picture to where "
            "all bands have values"
        )
    gains, offsets = (np.array(one)[:, None, None] for one in (header.gains, header.offsets))
    return values * gains + offsets
