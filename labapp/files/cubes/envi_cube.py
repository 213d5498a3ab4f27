"""Spectral cubes in ENVI's format, which most programs for spectral pictures read."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from labapp.common.errors import UserError
from labapp.files.cubes.cube import SpectralCube
from labapp.files.cubes.envi_header import EnviHeader, format_header, parse_header
from labapp.files.cubes.envi_numbers import EnviNumbers
from labapp.files.cubes.stored_values import StoredValues, file_state
from labapp.files.guarded_reading import MOST_TEXT_BYTES, is_file, read_bytes
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
    return format_header(keys).encode(), np.asarray(cube.values, "<f4").tobytes()


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
    sizes = {one: file_state(one).size for one in found}
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
