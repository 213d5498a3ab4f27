"""Repair what is damaged in a record and follows from the rest of it.

What the record's own copy has right is taken from there first. In older records, and where both are
damaged, four things follow. The table of places follows from HDF5's structure, if nothing else has
changed. Planned columns follow from the plan, and the digest of the structure tells whether the
repair is right. A frame's link follows from its image and settings; the next link, or the closing
digest, tells whether it is right. State and log of a run that hasn't ended may lack what a power
cut took.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import validate
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.record import layout
from labapp.runs.record.chain import AT_ONCE, follow_frames, follow_log, follows
from labapp.runs.record.digests import (
    ENDING,
    SETTINGS,
    closing_digest,
    first_link,
    image_digest,
    is_structure_proved,
    link_digest,
    pack_settings,
    packed_digest,
    structure_digest,
)
from labapp.runs.record.mending import mend_from_copy, mend_torn_end, renew_proved_copy
from labapp.runs.record.place_table import (
    PlaceTable,
    TableError,
    encode,
    read_table,
    rebuild_table,
    write_all,
)
from labapp.runs.record.second_copy import read_either_table
from labapp.runs.steps import planned_shots

Digests = Callable[[int], tuple[bytes, bytes]]
"""Returns the digest of a frame's image, and its settings as bytes, as they are in the file."""

EndProof = Callable[[int, bytes], bool]
"""Returns whether so many links, of which the last is given, are those of a run that has ended."""


def repair_record(path: Path, handle: int) -> list[str]:
    """Repair table, planned columns and links where that is surely right.

    Returns what was repaired, in words. Nothing else is changed.

    handle: that of open_for_writing().
    """
    try:
        table, done = _repaired_table(path, handle)
        done += mend_from_copy(handle, table)
        done += [*_repair_planned(handle, table, path), *_repair_links(handle, table)]
        if is_structure_proved(handle, table):
            done += mend_torn_end(handle, table)
        return [*done, *renew_proved_copy(handle, table)]
    except (TableError, KeyError):
        return []


def _repaired_table(path: Path, handle: int) -> tuple[PlaceTable, list[str]]:
    """Return the table of places, and what was done to it, in words."""
    try:
        return read_table(handle), []
    except TableError:
        pass
    with suppress(TableError):
        table = read_either_table(handle)
        write_all(handle, memoryview(encode(table)), 0)
        return table, ["the table of places, from the record's own copy"]
    proved = proved_table(path, handle)
    if proved is None:
        raise TableError("neither the table of places nor its copy is whole")
    write_all(handle, memoryview(encode(proved)), 0)
    return proved, ["the table of places, made anew and proved by the digest of the structure"]


def proved_table(path: Path, handle: int) -> PlaceTable | None:
    """Return the table of places made anew, as the digest of the structure proves it.

    None if HDF5 can't read the file, or something else has changed, too.
    """
    try:
        table = rebuild_table(path, handle)
        known = table.read(handle, f"{layout.DIGESTS}/structure").tobytes()
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, TableError):
        return None
    return table if structure_digest(handle, table, encode(table)) == known else None


def _repair_planned(handle: int, table: PlaceTable, path: Path) -> list[str]:
    """Write the planned columns anew if they alone have changed."""
    names = [f"{layout.DATA}/{name}" for name in layout.planned_names(table.places)]
    lost = [name for name in names if not table.is_whole(handle, name)]
    if not lost:
        return []
    before = {name: table.read(handle, name).tobytes() for name in lost}
    columns = planned_from_texts(handle, table, path)
    if columns is None:
        return []
    for name in lost:
        table.write(handle, name, columns[name.rpartition("/")[2]].tobytes())
    if is_structure_proved(handle, table):
        return [f"written anew from the plan: {', '.join(lost)}"]
    for name, data in before.items():
        table.write(handle, name, data)
    return []


def planned_from_texts(
    handle: int, table: PlaceTable, path: Path
) -> dict[str, NDArray[Any]] | None:
    """Return the planned columns that follow from the plan that is kept as text.

    None if the plan, or what else they follow from, has changed since it was written.
    """
    needed = ("entry/plan", "entry/capabilities", "entry/targets/names", "entry/patterns/names")
    if not all(table.is_whole(handle, name) for name in needed):
        return None
    plan, capabilities = (json.loads(table.read(handle, name).tobytes()) for name in needed[:2])
    targets, patterns = (
        [name.decode() for name in table.read(handle, one).tolist()] for one in needed[2:]
    )
    if not capabilities:
        return None
    try:
        shots = planned_shots(
            validate(plan, PlanFile, str(path)), BenchCapabilities.of_data(capabilities)
        )
        return layout.planned_columns(shots, targets, patterns)
    except (UserError, TypeError, ValueError):
        return None


def _repair_links(handle: int, table: PlaceTable) -> list[str]:
    """Write damaged links of frames anew where the next link proves them."""
    name = f"{layout.DIGESTS}/chain"
    structure = table.read(handle, f"{layout.DIGESTS}/structure").tobytes()
    if structure_digest(handle, table) != structure:
        # Nothing tells where the chain begins.
        return []
    stored = table.read(handle, f"{layout.DATA}/stored")
    blocks = table.read_blocks(handle, name, AT_ONCE)
    if follow_frames(blocks, structure, len(stored)).broken is None:
        return []
    rows = table.read(handle, name).copy()
    repaired = repair_links(
        rows, structure, stored, frame_digests(handle, table), end_proof(handle, table, structure)
    )
    if not repaired:
        return []
    table.write(handle, name, rows.tobytes())
    return [f"{len(repaired)} rows of the frames' digests, computed anew or cleared"]


def frame_digests(handle: int, table: PlaceTable, *, keep: bool = True) -> Digests:
    """Return the function that computes the digests of a frame.

    keep: whether it computes them once for each frame, which takes some 300 bytes.
    """
    place = table.places[f"{layout.DATA}/images"]
    columns = {name: table.read(handle, f"{layout.DATA}/{name}") for name in SETTINGS}

    def compute(frame: int) -> tuple[bytes, bytes]:
        data = os.pread(handle, place.row_bytes, place.offset + frame * place.row_bytes)
        settings = {name: column[frame] for name, column in columns.items()}
        return image_digest(np.frombuffer(data, np.uint8)), b"".join(
            pack_settings(settings).values()
        )

    return cache(compute) if keep else compute


def end_proof(handle: int, table: PlaceTable, structure: bytes) -> EndProof:
    """Return the function that compares links with the closing digest."""
    closing = table.read(handle, f"{layout.DIGESTS}/closing").tobytes()
    lines = follow_log(table.read_blocks(handle, "entry/log", AT_ONCE), structure)
    ending = [table.read(handle, f"{layout.ENTRY}/{name}").tobytes() for name in ENDING]

    def is_proved(links: int, last: bytes) -> bool:
        return closing == closing_digest(structure, links, last, lines.length, lines.last, ending)

    return is_proved


def repair_links(
    rows: NDArray[Any],
    structure: bytes,
    stored: NDArray[Any],
    compute: Digests,
    is_proved: EndProof,
) -> list[int]:
    """Compute damaged links of frames anew, in place; return their rows.

    A link is computed for the frame that its image and settings tell, otherwise for the one that
    lacks a link and comes next in the order of the plan. It is kept only if an undamaged link
    follows from it, or the closing digest proves it. Rows behind the last link that can be
    followed become zeros.
    """
    own = dict(_own_frames(rows, compute, len(stored)))
    missing = _frames_without_link(rows, stored, own)
    before, trial = first_link(structure), rows.copy()
    repaired: list[int] = []
    pending: list[int] = []
    length = 0
    for number in range(len(rows)):
        if not follows(trial[number], before):
            frame = own.get(number, missing[0] if missing else None)
            if frame is None:
                break
            missing = [one for one in missing if one != frame]
            image, values = compute(frame)
            settings = packed_digest(values)
            link = link_digest(before, frame, image, settings)
            parts = (np.frombuffer(one, np.uint8) for one in (image, settings, link, values))
            trial[number] = (frame, *parts)[: len(trial.dtype.names or ())]
            pending.append(number)
        else:
            repaired += pending
            pending = []
        before, length = trial[number]["link"].tobytes(), number + 1
    if pending and is_proved(length, before):
        repaired += pending
        pending = []
    end = pending[0] if pending else length
    cut = np.flatnonzero(rows[end:].view(np.uint8).reshape(len(rows) - end, -1).any(axis=1)) + end
    trial[end:] = np.zeros((), rows.dtype)
    rows[:] = trial
    return [*repaired, *cut.tolist()]


def _own_frames(rows: NDArray[Any], compute: Digests, frames: int) -> Iterator[tuple[int, int]]:
    """Yield number and frame of each row that has the digests of that frame."""
    for number, row in enumerate(rows):
        frame = int(row["frame"])
        if frame < frames and row["image"].any():
            image, values = compute(frame)
            settings = row["settings"].tobytes()
            if image == row["image"].tobytes() and packed_digest(values) == settings:
                yield number, frame


def _frames_without_link(
    rows: NDArray[Any], stored: NDArray[Any], own: Mapping[int, int]
) -> list[int]:
    """Return the stored frames that no row names, in the order of the plan.

    A row names its frame if it has the digests of the frame, or follows from the row before.
    """
    named = set(own.values())
    for before, row in pairwise(rows):
        if follows(row, before["link"].tobytes()):
            named.add(int(row["frame"]))
    return [frame for frame in np.flatnonzero(stored == 1).tolist() if frame not in named]
