"""A picture file a frame: TIFF and PNG."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import labapp
from labapp.files.writing import encode_image
from labapp.runs.export.export_job import ExportJob
from labapp.runs.record import layout


def write_tiffs(work: ExportJob, draft: Path) -> None:
    """Every file's description is what is known of its frame, as JSON."""
    import tifffile

    simulated = work.record.simulated_devices
    for name, row, image in zip(work.names, work.rows, work.images(), strict=False):
        description = json.dumps(row | {"units": layout.UNITS, "simulated": simulated})
        tifffile.imwrite(draft / name, image, **tiff_tags(work, description))


def write_pngs(work: ExportJob, draft: Path) -> None:
    for name, image in zip(work.names, work.images(), strict=False):
        (draft / name).write_bytes(encode_image(Path(name), image))


def tiff_tags(work: ExportJob, description: str) -> dict[str, Any]:
    """What TIFF files say of their pictures, as tifffile takes it."""
    told = {
        "photometric": "minisblack",
        "description": description,
        "software": f"labapp {labapp.__version__}",
        "metadata": None,
    }
    return told | _resolution(work)


def _resolution(work: ExportJob) -> dict[str, Any]:
    """In pixels a centimetre; x comes first there."""
    if work.pitch is None:
        return {}
    y, x = (1e-2 / pitch for pitch in work.pitch)
    return {"resolution": (x, y), "resolutionunit": "CENTIMETER"}
