"""Export each frame as a picture file of its own: TIFF or PNG."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import labapp
from labapp.files.picture.photograph_writing import encode_png, linear_tiff
from labapp.runs.export.export_job import ExportJob
from labapp.runs.record import layout


def write_tiffs(work: ExportJob, draft: Path) -> None:
    """Write each frame as a TIFF file, with its metadata as JSON description."""
    import tifffile

    simulated = work.record.simulated_devices
    for name, row, image in zip(work.names(), work.rows, work.images(), strict=False):
        description = json.dumps(row | {"units": layout.UNITS, "simulated": simulated})
        tifffile.imwrite(draft / name, image, **linear_tiff(image), **tiff_tags(work, description))


def write_pngs(work: ExportJob, draft: Path) -> None:
    """Write each frame as a PNG file."""
    for name, image in zip(work.names(), work.images(), strict=False):
        (draft / name).write_bytes(encode_png(Path(name), image, in_srgb=False))


def tiff_tags(work: ExportJob, description: str) -> dict[str, Any]:
    """Return a frame's TIFF tags, as arguments of tifffile; resolution (x, y) in pixels per cm."""
    told: dict[str, Any] = {
        "description": description,
        "software": f"labapp {labapp.__version__}",
        "metadata": None,
    }
    if work.pitch is not None:
        y, x = (1e-2 / pitch for pitch in work.pitch)
        told |= {"resolution": (x, y), "resolutionunit": "CENTIMETER"}
    return told
