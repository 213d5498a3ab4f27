"""One OME-TIFF file of all frames, for microscopy programs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from labapp.runs.export.naming import short
from labapp.runs.export.ome import Plane, Series, ome_xml
from labapp.runs.export.rows import heading
from labapp.runs.export.tiff import tags
from labapp.runs.export.work import Work

_TIFF_LIMIT = 2**32 - 2**25
"""Bytes that a TIFF file can have, with room for its tables of contents; more is BigTIFF."""


def write_ome_tiff(work: Work, draft: Path) -> None:
    import tifffile

    shape = (len(work.frames), *work.shape)
    description = ome_xml(_series(work))
    is_big = 2 * math.prod(shape) + len(description) > _TIFF_LIMIT
    with tifffile.TiffWriter(draft / work.names[0], bigtiff=is_big, ome=False) as file:
        file.write(work.images(), shape=shape, dtype=np.uint16, **tags(work, description))


def _series(work: Work) -> Series:
    record, rows = work.record, work.rows
    camera = record.devices.get("camera", {"model": "", "serial": ""})
    simulated = ", ".join(record.simulated)
    wavelengths = {row["wavelength"] for row in rows}
    return Series(
        name=record.text("title"),
        description=f"SIMULATED: {simulated}" if simulated else "taken with real devices",
        date=record.text("start_time"),
        shape=work.shape,
        pitch=work.pitch,
        bits=work.bits,
        wavelength=wavelengths.pop() if len(wavelengths) == 1 else None,
        model=camera["model"],
        serial=camera["serial"],
        planes=[Plane(row["exposure"], row["time"], _notes(row)) for row in rows],
    )


def _notes(row: dict[str, Any]) -> dict[str, str]:
    name = f"{row['target']}, {row['pattern']}, {short(row['wavelength'] * 1e9)} nm"
    return {"name": name} | {heading(key): str(value) for key, value in row.items()}
