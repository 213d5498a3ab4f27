"""Create a record with all of its datasets in place before the first frame."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

import labapp
from drivers.interfaces import Identity
from labapp.common.errors import UserError
from labapp.files import nexus
from labapp.files.hdf5_output import create_hdf5
from labapp.files.plan_file import ROLES
from labapp.files.write_locks import close_locked, lock_file, move_into_place, name_draft
from labapp.files.writing import require_writable, sync_to_disk
from labapp.runs.record import layout, writer_process
from labapp.runs.record.digests import structure_digest
from labapp.runs.record.place_table import (
    USER_BLOCK,
    encode,
    rebuild_table,
    write_all,
)
from labapp.runs.shots import Shot, ShotList
from labapp.runs.state import State

_ROWS_AT_ONCE = 1 << 12
"""Rows that are written at once to a dataset without content: a megabyte. Chosen."""


@dataclass(frozen=True)
class RecordContents:
    """The contents of a run's record that are known before its first frame.

    Attributes
    ----------
    plan, bench, scene, effect_plan : plain data
        The files of the run, and the simulator's effect plans. The last two are None for a real
        bench.
    identities : mapping of Identity
        Model and serial number of the devices by role.
    targets : sequence of str
        Names of the targets.
    patterns : mapping of arrays of uint8
        Grey levels by name, (rows, columns), or (frames, rows, columns) of a video.
    shots : sequence of Shot
        The planned frames.
    frame_shape : (rows, columns)
        Shape of the largest frame.
    pixel_pitch : float
        Pitch of the sensor in metres.
    video_frame : float
        Seconds for which a frame of a video is shown.
    pictures : mapping of str
        SHA-256 of the scene's picture files, by path.
    faults : sequence of plain data
        Script of the faults of a virtual bench.
    clock : str
        "real" or "virtual".
    capabilities : plain data
        What the bench can do, from which the planned columns follow.
    """

    title: str
    seed: int
    plan: dict[str, Any]
    bench: dict[str, Any]
    scene: dict[str, Any] | None
    effect_plan: dict[str, Any] | None
    identities: Mapping[str, Identity]
    targets: Sequence[str]
    patterns: Mapping[str, NDArray[np.uint8]]
    shots: Sequence[Shot]
    frame_shape: tuple[int, int]
    pixel_pitch: float
    video_frame: float = 0.0
    pictures: Mapping[str, str] = field(default_factory=dict)
    faults: Sequence[dict[str, Any]] = ()
    clock: str = "real"
    capabilities: Mapping[str, Any] = field(default_factory=dict)


def create_record(path: Path, contents: RecordContents, *, force: bool = False) -> int:
    """Create a run's record without frames; with `force`, an existing file may be replaced.

    The record is written under a temporary name and renamed when it is complete, so that a
    failure leaves no partial record, and keeps an existing one. Raises UserError if the record
    can't be written, or another process writes a file of this name.

    Returns
    -------
    int
        Handle of the record, for RecordWriter. It has held the lock since before the record got
        its name, so that nobody else can write or replace it in between.
    """
    require_writable(path, force=force)
    draft = name_draft(path)
    handle = -1
    try:
        handle = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        lock_file(handle)
        writer_process.warn_of_lock(path, handle)
        with create_hdf5(handle, libver="latest", userblock_size=USER_BLOCK) as file:
            _fill(file, contents)
        _protect(draft)
        sync_to_disk(draft)
        move_into_place(draft, path, force=force)
        sync_to_disk(path.parent)
        created, handle = handle, -1
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written: {error.strerror or error}. Choose another place."
        ) from error
    finally:
        if handle >= 0:
            close_locked(handle)
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
    return created


def _protect(draft: Path) -> None:
    """Write a new record's table of places, and the digest of its structure."""
    handle = os.open(draft, os.O_RDWR | os.O_CLOEXEC)
    try:
        table = rebuild_table(draft, handle)
        write_all(handle, memoryview(encode(table)), 0)
        digest = structure_digest(handle, table)
        place = table.places[f"{layout.DIGESTS}/structure"]
        write_all(handle, memoryview(digest), place.offset)
    finally:
        os.close(handle)


def utc_timestamp() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _fill(file: h5py.File, c: RecordContents) -> None:
    file.attrs.update(
        {
            "NX_class": "NXroot",
            "default": layout.ENTRY,
            "creator": "labapp",
            "creator_version": labapp.__version__,
            "labapp_format": layout.FORMAT,
        }
    )
    entry = nexus.create_group(file, layout.ENTRY, "NXentry")
    entry.attrs["default"] = "data"
    texts = {"title": c.title, "definition": "labapp_run", "start_time": utc_timestamp()}
    for name in ("plan", "bench", "scene", "effect_plan", "pictures", "faults", "capabilities"):
        texts[name] = json.dumps(getattr(c, name))
    texts["clock"] = c.clock
    texts["versions"] = json.dumps(nexus.program_versions())
    for name, text in texts.items():
        write_text(entry, name, text)
    listed = ShotList.of(c.shots)
    write_text(entry, "readouts", json.dumps([one.as_data() for one in listed.readouts]))
    entry["seed"] = c.seed
    entry["expected_seconds"] = listed.total_duration
    allocate(entry, "state", np.array([State.PLANNED.value.encode()], layout.STATE))
    allocate(entry, "message", np.zeros(1, layout.MESSAGE))
    allocate(entry, "end_time", np.zeros(1, layout.END_TIME_DTYPE))
    allocate(
        entry, "writer", np.array([writer_process.describe_this_process().encode()], layout.WRITER)
    )
    _allocate_rows(entry, "log", layout.log_capacity(len(c.shots)), layout.LOG_ROW)
    allocate(entry, "log_lost", np.zeros(1, np.uint64))
    digests = nexus.create_group(file, layout.DIGESTS, "NXcollection")
    for name in ("structure", "closing"):
        allocate(digests, name, np.zeros(1, layout.DIGEST))
    _allocate_rows(digests, "chain", layout.chain_capacity(len(c.shots)), layout.CHAIN_ROW)
    instrument = nexus.create_group(entry, "instrument", "NXinstrument")
    for name, identity in c.identities.items():
        device = nexus.create_group(
            instrument, name, "NXdetector" if name == "camera" else "NXobject"
        )
        write_text(device, "model", identity.model)
        write_text(device, "serial", identity.serial)
        device["simulated"] = identity.simulated
    _fill_patterns(file, c)
    _fill_data(file, c)


def _fill_patterns(file: h5py.File, c: RecordContents) -> None:
    patterns = nexus.create_group(file, layout.PATTERNS, "NXcollection")
    videos = [image if image.ndim == 3 else image[None] for image in c.patterns.values()]
    lengths = [len(video) for video in videos]
    patterns["images"] = np.concatenate(videos)
    write_text(patterns, "names", list(c.patterns))
    patterns["first"] = np.cumsum([0, *lengths[:-1]])
    patterns["frames"] = lengths
    times = [c.video_frame if image.ndim == 3 else 0.0 for image in c.patterns.values()]
    patterns["frame_time"] = times
    patterns["frame_time"].attrs["units"] = "s"
    sums = [sha256(image.tobytes()).hexdigest() for image in c.patterns.values()]
    write_text(patterns, "sha256", sums)
    write_text(nexus.create_group(file, "entry/targets", "NXcollection"), "names", list(c.targets))


def _fill_data(file: h5py.File, c: RecordContents) -> None:
    data = nexus.create_group(file, layout.DATA, "NXdata")
    n, (rows, columns) = len(c.shots), c.frame_shape
    data.attrs.update({"signal": "images", "axes": list(layout.AXES)})
    for name, size in (("y", rows), ("x", columns)):
        data[name] = (np.arange(size) - size // 2) * c.pixel_pitch
    planned = layout.planned_columns(c.shots, list(c.targets), list(c.patterns))
    for name, values in planned.items():
        allocate(data, name, values)
    for name, dtype in layout.MEASURED.items():
        allocate(data, name, np.zeros(n, dtype))
    for name, unit in layout.UNITS.items():
        data[name].attrs["units"] = unit
    data["role"].attrs["names"] = list(ROLES)
    reserve(data, "images", (n, rows, columns), np.dtype("u2"))
    data["images"].attrs.update({"units": "DN", "interpretation": "image"})
    for axis, name in zip(data["images"].dims, layout.AXES, strict=True):
        axis.label = name


def write_text(parent: h5py.Group, name: str, text: str | list[str]) -> None:
    """Write text of fixed length to a run's record.

    HDF5 keeps text of variable length in a heap, and may hang if the heap is damaged.
    """
    encoded = text.encode() if isinstance(text, str) else [one.encode() for one in text]
    kind = h5py.string_dtype("utf-8", np.array(encoded, dtype=bytes).dtype.itemsize)
    parent.create_dataset(name, data=np.array(encoded, dtype=kind))


def allocate(parent: h5py.Group, name: str, values: NDArray[Any]) -> None:
    """Create a contiguous dataset of a run's record, and write it so that disk space is taken."""
    parent.create_dataset(name, data=values)


def _allocate_rows(parent: h5py.Group, name: str, count: int, kind: np.dtype) -> None:
    """Create a dataset of empty rows in a run's record, and write it so that space is taken."""
    dataset = parent.create_dataset(name, (count,), kind)
    empty = np.zeros(min(count, _ROWS_AT_ONCE), kind)
    for first in range(0, count, _ROWS_AT_ONCE):
        dataset[first : first + _ROWS_AT_ONCE] = empty[: count - first]


def reserve(parent: h5py.Group, name: str, shape: tuple[int, ...], dtype: np.dtype) -> None:
    """Reserve a fixed place for a contiguous dataset in a run's record, without disk space."""
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_layout(h5py.h5d.CONTIGUOUS)
    how.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    how.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    kind = h5py.h5t.py_create(dtype, logical=True)
    h5py.h5d.create(parent.id, name.encode(), kind, h5py.h5s.create_simple(shape), how)
