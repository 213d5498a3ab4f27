"""Export frames as one NumPy array, with their metadata as JSON."""

from __future__ import annotations

import json
import math
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from labapp.runs.export.export_job import ExportJob
from labapp.runs.record import layout


def write_npy(work: ExportJob, draft: Path) -> None:
    """Write the frames as one .npy array, with their metadata as JSON."""
    array, described = islice(work.names(), 2)
    shape = (len(work.frames), *work.shape)
    header = {"descr": "<u2", "fortran_order": False, "shape": shape}
    with (draft / array).open("wb") as file:
        np.lib.format.write_array_header_2_0(file, header)
        for image in work.images():
            file.write(image.astype("<u2", order="C", copy=False).data)
    with (draft / described).open("w") as text:
        _write_described(text, work)


def _write_described(text: TextIO, work: ExportJob) -> None:
    """Write the metadata of the frames as JSON; NaN and infinity are null."""
    # Each item has its own line, so that the file is readable although columns are long.
    text.write("{\n")
    for key, one in _facts(work).items():
        text.write(f"{json.dumps(key)}: {json.dumps(one)},\n")
    text.write('"columns": {')
    for number, name in enumerate(work.rows.columns):
        text.write(f"{', ' if number else ''}{json.dumps(name)}: [")
        for part, values in enumerate(work.rows.blocks(name)):
            listed = json.dumps([_number(value) for value in values])
            text.write((", " if part else "") + listed[1:-1])
        text.write("]")
    text.write("}\n}\n")


def _facts(work: ExportJob) -> dict[str, Any]:
    """Return what the frames have in common, as plain data."""
    record = work.record
    return {
        "record": str(record.path),
        "title": record.text("title"),
        "state": record.state.value,
        "simulated": record.simulated_devices,
        "devices": record.devices,
        "seed": record.seed,
        "start_time": record.text("start_time"),
        "axes": list(layout.AXES),
        "pixel_pitch_m": work.pitch,
        "bits": work.bits,
        "units": layout.UNITS,
        "targets": record.target_names,
        "patterns": record.pattern_names,
        "plan": json.loads(record.text("plan")),
        "bench": json.loads(record.text("bench")),
    }


def _number(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
