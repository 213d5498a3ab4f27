"""The layout of a record, and how it is protected against damage.

/entry (NXentry)
    title, definition, seed, start_time, expected_seconds      scalars
    clock            "real", or "virtual" where time moves as the plan says
    end_time, state, message, writer   (1,)  see labapp.runs.state; the reason for the state;
                     the writing process: host, number, start (JSON)
    plan, bench, scene, faults, versions, capabilities         as run (JSON)
    effect_plan      the simulator's effect plans (JSON, null for a real bench): "effects",
                     descriptions by name; "plans", one for each different target, pattern,
                     wavelength, exposure and gain. Older records have one by "pattern,
                     wavelength"
    readouts         how the sensor is read (JSON): gain, region, binning, number of frames whose
                     mean is stored, and in how many steps of 1 DN
    pictures         SHA-256 of the simulated scene's picture files (JSON)
    instrument (NXinstrument) slm, filter, camera, targets: model, serial, simulated
    data (NXdata), one row per planned frame, axes frame, y, x
        images       (n, rows, columns) uint16, raw digital numbers; of parts of the sensor and
                     of binned pixels from the first row and column on, with zeros around
        y, x         metres on the sensor, origin at n // 2
        frame, step, repeat, role, target, pattern, slot, readout     as planned
        exposure, exposure_asked, wavelength, wavelength_asked, gain
        time         bench clock at which the exposure began; on a virtual bench the
                     planned time, which doesn't change by retries and resumptions
        timestamp    wall clock at which the frame was stored, seconds since 1970
        number       the camera's own frame number
        attempts     number of attempts at the frame
        checksum     CRC-32 of the image's bytes
        stored       1 once the frame is on the disk
    patterns/images  (p, rows, columns) uint8, as shown, frames of videos one by one
    patterns/names, first, frames, frame_time, sha256      for each pattern: index of its first
                     image, number of images, seconds for which each is shown (0: a still)
    targets/names
    log              time (bench clock) and text of what happened, and the digest of each line
    log_lost         (1,) lines that a full log had no room for
    digests          structure, chain, closing: see labapp.runs.record.digests
    copy             bytes: all that stands before the log, once more

The file begins with a user block: the table of places (see labapp.runs.record.place_table), which
tells without HDF5 where every dataset lies. Then come HDF5's own structure and all datasets but the
large ones, which end the file: log, patterns/images, data/images, copy. See
labapp.runs.record.second_copy.

`target` and `pattern` are indices into the names, `readout` into readouts, `role` into ROLES; slot
0 is a tunable filter. Records of older programs have no `readout` and readouts, and those of format
3 no copy and no values in their chain.

All datasets are contiguous, and are created before the first frame. HDF5 itself never writes again:
the writer puts values at their known places in the file. Therefore readers, in SWMR mode or not,
may open the file at any time. A writer that is killed can't leave the structure half-written, and a
full disk damages only the frame that was being written.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.runs.shots import Shot, ShotList

FORMAT = 4

FORMAT_WITHOUT_COPY = 3
"""Format of records that are read and written on, but have nothing twice."""

PROTECTED_FORMATS = (FORMAT, FORMAT_WITHOUT_COPY)

UNPROTECTED_FORMAT = 2
"""Format of records that are read, too, but have no digests."""

ENTRY = "entry"
DATA = "entry/data"
PATTERNS = "entry/patterns"

AXES = ("frame", "y", "x")

PLANNED: dict[str, np.dtype] = {
    "frame": np.dtype("u4"),
    "step": np.dtype("u4"),
    "repeat": np.dtype("u4"),
    "role": np.dtype("u1"),
    "target": np.dtype("u2"),
    "pattern": np.dtype("u2"),
    "slot": np.dtype("u2"),
    "readout": np.dtype("u2"),
    "exposure_asked": np.dtype("f8"),
    "wavelength_asked": np.dtype("f8"),
}
"""Columns that are known before the first frame."""

READOUTS = f"{ENTRY}/readouts"

MEASURED: dict[str, np.dtype] = {
    "exposure": np.dtype("f8"),
    "wavelength": np.dtype("f8"),
    "gain": np.dtype("f8"),
    "time": np.dtype("f8"),
    "timestamp": np.dtype("f8"),
    "number": np.dtype("u8"),
    "attempts": np.dtype("u2"),
    "checksum": np.dtype("u4"),
    "stored": np.dtype("u1"),
}
"""Columns that are written with each frame."""

UNSEEDED = ("timestamp", "number", "attempts")
"""Columns that differ between runs of the same plan and seed."""

UNITS = {
    "exposure": "s",
    "exposure_asked": "s",
    "wavelength": "m",
    "wavelength_asked": "m",
    "gain": "electron/DN",
    "time": "s",
    "timestamp": "s",
    "y": "m",
    "x": "m",
}

DIGEST = np.dtype(("u1", (32,)))
"""A SHA-256."""

LOG_ROW = np.dtype([("time", "f8"), ("text", "S200"), ("digest", DIGEST)])

VALUES = np.dtype(("u1", (sum(k.itemsize for n, k in MEASURED.items() if n != "stored"),)))
"""A frame's measured columns without `stored`, as bytes in their order."""

_LINK = [("frame", "u4"), ("image", DIGEST), ("settings", DIGEST), ("link", DIGEST)]

LINK_ROW = np.dtype(_LINK)
"""Rows of the chain in records without a copy."""

CHAIN_ROW = np.dtype([*_LINK, ("values", VALUES)])
"""What is appended for each stored frame: see labapp.runs.record.digests."""

STATE = np.dtype("S16")
MESSAGE = np.dtype("S800")
WRITER = np.dtype("S400")
END_TIME_DTYPE = np.dtype("S40")

DIGESTS = "entry/digests"

CHANGING = (
    *(f"{ENTRY}/{name}" for name in ("state", "message", "end_time", "writer", "log", "log_lost")),
    *(f"{DIGESTS}/{name}" for name in ("structure", "chain", "closing")),
    *(f"{DATA}/{name}" for name in MEASURED),
    f"{DATA}/images",
    f"{ENTRY}/copy",
)
"""Datasets that are written after a record has been made."""

COPY = f"{ENTRY}/copy"

LARGE = (f"{ENTRY}/log", f"{PATTERNS}/images", f"{DATA}/images", COPY)
"""Datasets that end the file, in their order; the copy is of all that stands before them."""

SHOWN_IMAGES = f"{PATTERNS}/images"
"""Dataset that never changes, but is large; the table of places has its digest."""


def planned_names(there: Collection[str]) -> list[str]:
    """Return the planned columns among the datasets that are there.

    Records of older programs have none that says how the sensor was read.
    """
    return [name for name in PLANNED if name != "readout" or f"{DATA}/{name}" in there]


def log_capacity(frames: int) -> int:
    """Return how many log lines have room, enough for some failures and resumptions."""
    return 256 + 6 * frames


def chain_capacity(frames: int) -> int:
    """Return how many links have room, enough for frames that are taken again."""
    return 256 + 2 * frames


def planned_columns(
    shots: Iterable[Shot], targets: Sequence[str], patterns: Sequence[str]
) -> dict[str, NDArray[Any]]:
    """Return the columns that follow from the shots, by name.

    Raises ValueError if a shot has a target or pattern that isn't among the names.
    """
    listed = ShotList.of(shots)
    named = {"frame": "index", "exposure_asked": "exposure", "wavelength_asked": "wavelength"}
    found = {name: listed.column(named.get(name, name)) for name in PLANNED}
    found["target"] = _renumbered(found["target"], [one.name for one in listed.targets], targets)
    found["pattern"] = _renumbered(found["pattern"], listed.patterns, patterns)
    return {name: found[name].astype(dtype, copy=False) for name, dtype in PLANNED.items()}


def _renumbered(
    indices: NDArray[Any], names: Sequence[str], wanted: Sequence[str]
) -> NDArray[np.intp]:
    """Turn indices into names into those of the same names in another order."""
    others = np.zeros(len(names), np.intp)
    for index in np.unique(indices):
        others[index] = wanted.index(names[index])
    return others[indices]
