"""Export frames as one NumPy array, with their metadata as JSON."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from labapp.runs.export.export_job import ExportJob
from labapp.runs.record import layout


def write_npy(work: ExportJob, draft: Path) -> None:
    """Write a run's exported frames as one .npy array, with their metadata as JSON."""
    path = draft / work.names[0]
    shape = (len(work.frames), *work.shape)
    array = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint16, shape=shape)
    # Without allocation, a full disk would end the process when the mapped file is written.
    with path.open("rb+") as file:
        os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
    for place, image in enumerate(work.images()):
        array[place] = image
    array.flush()
    # Each item has its own line, so that the file is readable although columns are long.
    items = [f"{json.dumps(key)}: {json.dumps(one)}" for key, one in _as_data(work).items()]
    (draft / work.names[1]).write_text("{\n" + ",\n".join(items) + "\n}\n")


def _as_data(work: ExportJob) -> dict[str, Any]:
    """Return the metadata of a run's exported frames as plain data; NaN and infinity are null."""
    record = work.record
    columns = {name: [_number(row[name]) for row in work.rows] for name in work.rows[0]}
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
        "columns": columns,
        "plan": json.loads(record.text("plan")),
        "bench": json.loads(record.text("bench")),
    }


def _number(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
