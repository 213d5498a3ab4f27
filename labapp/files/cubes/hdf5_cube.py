"""Spectral cubes as HDF5 files that describe themselves.

/  default "entry"
/entry (NXentry)     title, definition "labapp_cube", light, description, version of labapp
    data (NXdata)    signal "values", axes wavelength, y, x, as dimension scales too
        values       (bands, rows, columns) float32, unit in the attribute "units"
        error        the same shape: half width of the 90 % interval; absent if it isn't known
        wavelength   (bands,) metres
        y, x         metres on the sensor, origin at n // 2; numbers of pixels without a pitch
"""

from __future__ import annotations

import io
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import labapp
from labapp.common.errors import UserError
from labapp.files.cubes.cube import SpectralCube
from labapp.files.cubes.stored_values import StoredValues, Values, Window
from labapp.files.hdf5_output import create_group
from labapp.files.plain_hdf5 import open_plain_hdf5

DEFINITION = "labapp_cube"

_ERROR_NAME = "half width of the interval that holds the true value with a probability of 90 %"

_PIXELS = "pixel"
"""Unit of the axes y and x of a cube whose pitch isn't known."""


def encode_hdf5(cube: SpectralCube) -> bytes:
    """Return the bytes of a spectral cube's HDF5 file."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["default"] = "entry"
        entry = create_group(file, "entry", "NXentry")
        entry.attrs["default"] = "data"
        entry["title"] = "Spectral cube"
        entry["definition"] = DEFINITION
        entry["labapp_version"] = labapp.__version__
        entry["light"], entry["description"] = cube.light, cube.description
        data = create_group(entry, "data", "NXdata")
        data.attrs["signal"] = "values"
        data.attrs["axes"] = ["wavelength", "y", "x"]
        _write_axes(data, cube)
        _write_picture(data, "values", cube.values, cube.unit, "value of each band at each pixel")
        if cube.error is not None:
            _write_picture(data, "error", cube.error, cube.unit, _ERROR_NAME)
    return buffer.getvalue()


def read_hdf5(path: Path) -> SpectralCube:
    """Read what a file says of its cube; the numbers are read when they are used.

    Raises UserError if it is another file or damaged.
    """
    with open_plain_hdf5(path) as file:
        kind = file["entry/definition"][()].decode() if "entry/definition" in file else "unknown"
        if kind != DEFINITION:
            raise UserError(
                f"is an HDF5 file of kind {kind!r}, and not a spectral cube. Give a cube that "
                "labapp wrote, or an ENVI header, .hdr"
            )
        data = file["entry/data"]
        unit = data["wavelength"].attrs["units"]
        if unit != "m":
            raise UserError(f"wavelengths are in {unit!r}; a cube has metres, 'm'")
        pitch = data.attrs.get("pixel_pitch")
        return SpectralCube(
            _stored_values(path, data, "values"),
            tuple(data["wavelength"][()].tolist()),
            str(data["values"].attrs["units"]),
            _stored_values(path, data, "error") if "error" in data else None,
            file["entry/light"][()].decode(),
            None if pitch is None else float(pitch),
            file["entry/description"][()].decode(),
        )


def _write_axes(data: h5py.Group, cube: SpectralCube) -> None:
    """Write wavelengths and positions as dimension scales."""
    data["wavelength"] = np.array(cube.wavelengths)
    data["wavelength"].attrs["units"] = "m"
    for name, count in zip("yx", cube.shape[1:], strict=True):
        place = np.arange(count) - count // 2
        data[name] = place * (1.0 if cube.pitch is None else cube.pitch)
        data[name].attrs["units"] = _PIXELS if cube.pitch is None else "m"
    for name in ("wavelength", "y", "x"):
        data[name].make_scale(name)
    if cube.pitch is not None:
        data.attrs["pixel_pitch"] = cube.pitch
        data.attrs["pixel_pitch_units"] = "m"


def _write_picture(data: h5py.Group, name: str, values: Any, unit: str, words: str) -> None:
    """Write the values or their error map, a chunk for each band, compressed."""
    chunk = (1, *values.shape[1:])
    made = data.create_dataset(name, data=values, chunks=chunk, compression="gzip", shuffle=True)
    made.attrs["units"], made.attrs["long_name"] = unit, words
    for axis, scale in enumerate(("wavelength", "y", "x")):
        made.dims[axis].label = scale
        made.dims[axis].attach_scale(data[scale])


def _stored_values(path: Path, data: h5py.Group, name: str) -> StoredValues:
    """Return a dataset's numbers, which stay in the file until they are indexed."""
    found = data[name]
    if found.ndim != 3 or found.dtype.kind not in "iuf":
        raise UserError(
            f"{name} are {found.dtype} numbers of shape {found.shape}. Give real ones, (bands, "
            "rows, columns)"
        )
    return StoredValues(path, found.shape, partial(_read_window, path, found.name))


def _read_window(path: Path, name: str, window: Window) -> Values:
    """Read a window of the dataset of that name, a band at a time."""
    bands, rows, columns = window
    made = np.empty((len(bands), len(rows), len(columns)), np.float32)
    with open_plain_hdf5(path) as file:
        for place, band in enumerate(bands):
            made[place] = file[name][band, rows.start : rows.stop, columns.start : columns.stop]
    return made
