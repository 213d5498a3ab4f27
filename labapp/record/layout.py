"""Where everything is in a record, and why it can be trusted.

/entry (NXentry)
    title, definition, seed, start_time, end_time     scalars
    state            (1,)  see labapp.acquisition.state
    writer           who writes: host, process, start of the process (JSON)
    plan, bench, scene, effect_plan, versions          as run (JSON)
    message          (1,)  why the run ended as it did
    instrument (NXinstrument) slm, filter, camera, targets: model, serial, simulated
    data (NXdata), one row a planned frame, axes frame, y, x
        images       (n, rows, columns) uint16, raw digital numbers
        y, x         metres on the sensor, origin at n // 2
        frame, step, repeat, target, pattern
        exposure, exposure_asked, wavelength, wavelength_asked, gain, time
        checksum     CRC-32 of the image's bytes
        stored       1 once the frame is on disk: only then was it acknowledged
    patterns/images  (p, rows, columns) uint8, as shown; names, sha256
    targets/names
    log              time and text of what happened, in the bench's time

`target` and `pattern` are indices into the names. Times are the bench clock's seconds;
only start_time and end_time are of the wall clock. All datasets are made before the
first frame, then the file is opened to readers (SWMR) and only values are written.
"""

from __future__ import annotations

import numpy as np

FORMAT = 1

ENTRY = "entry"
DATA = "entry/data"
PATTERNS = "entry/patterns"

COLUMNS: dict[str, np.dtype] = {
    "frame": np.dtype("u4"),
    "step": np.dtype("u4"),
    "repeat": np.dtype("u4"),
    "target": np.dtype("u2"),
    "pattern": np.dtype("u2"),
    "exposure_asked": np.dtype("f8"),
    "wavelength_asked": np.dtype("f8"),
    "exposure": np.dtype("f8"),
    "wavelength": np.dtype("f8"),
    "gain": np.dtype("f8"),
    "time": np.dtype("f8"),
    "checksum": np.dtype("u4"),
    "stored": np.dtype("u1"),
}

UNITS = {
    "exposure": "s",
    "exposure_asked": "s",
    "wavelength": "m",
    "wavelength_asked": "m",
    "gain": "electron/DN",
    "time": "s",
    "y": "m",
    "x": "m",
}

LOG_ROW = np.dtype([("time", "f8"), ("text", "S200")])
STATE_TYPE = np.dtype("S16")
MESSAGE_TYPE = np.dtype("S400")


def log_rows(frames: int) -> int:
    """Room in the log for a run of this many frames."""
    return 64 + 4 * frames
