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
from labapp.files.hdf5_output import create_group, create_hdf5, program_versions
from labapp.files.plan_file import ROLES
from labapp.files.write_locks import close_locked, lock_file, move_into_place, name_draft
from labapp.files.writing import require_writable, sync_to_disk
from labapp.runs.record import layout, writer_process
from labapp.runs.record.datasets import DraftLedger, write_empty
from labapp.runs.record.digests import structure_digest
from labapp.runs.record.place_table import USER_BLOCK, encode, write_all
from labapp.runs.record.second_copy import renew_copy, room_for_copy
from labapp.runs.shots import Shot, ShotList
from labapp.runs.state import State

_COPY_STRUCTURE = 1 << 14
"""Bytes that HDF5 needs at most for the structure of the copy itself; it takes less than one kB."""


@dataclass(frozen=True)
class RecordContents:
    """What is known before the first frame.

    plan, bench, scene, effect_plan: the files, and the simulator's effect plans, as plain data. The
        last two are None for a real bench.
    identities: model and serial number of the devices by role.
    targets: names.
    patterns: grey levels by name, (rows, columns), or (frames, rows, columns) of a video.
    shots: the planned frames.
    frame_shape: of the largest frame, (rows, columns).
    pixel_pitch: of the sensor, metres.
    video_frame: seconds for which a frame of a video is shown.
    pictures: SHA-256 of the scene's picture files, by path.
    faults: script of the faults of a virtual bench, as plain data.
    clock: "real" or "virtual".
    capabilities: what the bench can do, from which the planned columns follow, as plain data.
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
    """Create a record without frames; return its handle, for RecordWriter.

    The handle has held the lock since before the record got its name, so that nobody else can write
    or replace it in between. The record is written under a temporary name and renamed when it is
    complete, so that a failure leaves no partial record, and keeps an existing one. Raises
    UserError if the record can't be written, or another process writes a file of this name.

    force: whether an existing file may be replaced.
    """
    require_writable(path, force=force)
    draft = name_draft(path)
    handle = -1
    try:
        handle = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        lock_file(handle)
        writer_process.warn_of_lock(path, handle)
        ledger = DraftLedger()
        with create_hdf5(handle, libver="latest", userblock_size=USER_BLOCK) as file:
            _fill(file, contents, ledger)
        _protect(draft, ledger)
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


def _protect(draft: Path, ledger: DraftLedger) -> None:
    """Write a draft's table of places, the digest of its structure, and its copy.

    Raises OSError if the draft doesn't read back as what was written to it.
    """
    handle = os.open(draft, os.O_RDWR | os.O_CLOEXEC)
    try:
        table = ledger.read_back(draft, handle)
        write_all(handle, memoryview(encode(table)), 0)
        table.write(handle, f"{layout.DIGESTS}/structure", structure_digest(handle, table))
        renew_copy(handle, table, is_new=True)
    finally:
        os.close(handle)


def utc_timestamp() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _fill(file: h5py.File, c: RecordContents, ledger: DraftLedger) -> None:
    file.attrs.update(
        {
            "NX_class": "NXroot",
            "default": layout.ENTRY,
            "creator": "labapp",
            "creator_version": labapp.__version__,
            "labapp_format": layout.FORMAT,
        }
    )
    entry = create_group(file, layout.ENTRY, "NXentry")
    entry.attrs["default"] = "data"
    texts = {"title": c.title, "definition": "labapp_run", "start_time": utc_timestamp()}
    for name in ("plan", "bench", "scene", "effect_plan", "pictures", "faults", "capabilities"):
        texts[name] = json.dumps(getattr(c, name))
    texts["clock"] = c.clock
    texts["versions"] = json.dumps(program_versions())
    for name, text in texts.items():
        ledger.write_text(entry, name, text)
    listed = ShotList.of(c.shots)
    ledger.write_text(entry, "readouts", json.dumps([one.as_data() for one in listed.readouts]))
    ledger.allocate(entry, "seed", np.array(c.seed))
    ledger.allocate(entry, "expected_seconds", np.array(listed.total_duration))
    ledger.allocate(entry, "state", np.array([State.PLANNED.value.encode()], layout.STATE))
    ledger.allocate(entry, "message", np.zeros(1, layout.MESSAGE))
    ledger.allocate(entry, "end_time", np.zeros(1, layout.END_TIME_DTYPE))
    ledger.allocate(
        entry, "writer", np.array([writer_process.describe_this_process().encode()], layout.WRITER)
    )
    ledger.allocate(entry, "log_lost", np.zeros(1, np.uint64))
    digests = create_group(file, layout.DIGESTS, "NXcollection")
    for name in ("structure", "closing"):
        ledger.allocate(digests, name, np.zeros(1, layout.DIGEST))
    rows = layout.chain_capacity(len(c.shots))
    write_empty(ledger.reserve(digests, "chain", (rows,), layout.CHAIN_ROW))
    instrument = create_group(entry, "instrument", "NXinstrument")
    for name, identity in c.identities.items():
        device = create_group(instrument, name, "NXdetector" if name == "camera" else "NXobject")
        ledger.write_text(device, "model", identity.model)
        ledger.write_text(device, "serial", identity.serial)
        ledger.allocate(device, "simulated", np.array(identity.simulated))
    _fill_patterns(file, c, ledger)
    _fill_data(file, c, ledger)
    _fill_large(file, c, ledger)
    ledger.note_attributes(file)


def _fill_patterns(file: h5py.File, c: RecordContents, ledger: DraftLedger) -> None:
    patterns = create_group(file, layout.PATTERNS, "NXcollection")
    videos = [image if image.ndim == 3 else image[None] for image in c.patterns.values()]
    lengths = [len(video) for video in videos]
    ledger.write_text(patterns, "names", list(c.patterns))
    ledger.allocate(patterns, "first", np.cumsum([0, *lengths[:-1]]))
    ledger.allocate(patterns, "frames", np.array(lengths))
    times = [c.video_frame if image.ndim == 3 else 0.0 for image in c.patterns.values()]
    ledger.allocate(patterns, "frame_time", np.array(times))
    patterns["frame_time"].attrs["units"] = "s"
    sums = [sha256(image.tobytes()).hexdigest() for image in c.patterns.values()]
    ledger.write_text(patterns, "sha256", sums)
    ledger.write_text(create_group(file, "entry/targets", "NXcollection"), "names", list(c.targets))


def _fill_data(file: h5py.File, c: RecordContents, ledger: DraftLedger) -> None:
    data = create_group(file, layout.DATA, "NXdata")
    n, (rows, columns) = len(c.shots), c.frame_shape
    data.attrs.update({"signal": "images", "axes": list(layout.AXES)})
    for name, size in (("y", rows), ("x", columns)):
        ledger.allocate(data, name, (np.arange(size) - size // 2) * c.pixel_pitch)
    planned = layout.planned_columns(c.shots, list(c.targets), list(c.patterns))
    for name, values in planned.items():
        ledger.allocate(data, name, values)
    for name, dtype in layout.MEASURED.items():
        ledger.allocate(data, name, np.zeros(n, dtype))
    for name, unit in layout.UNITS.items():
        data[name].attrs["units"] = unit
    data["role"].attrs["names"] = list(ROLES)


def _fill_large(file: h5py.File, c: RecordContents, ledger: DraftLedger) -> None:
    """Make the datasets that end the file: first all of HDF5's own structure, then their data."""
    entry, n = file[layout.ENTRY], len(c.shots)
    videos = [image if image.ndim == 3 else image[None] for image in c.patterns.values()]
    shown = np.concatenate(videos)
    rows = layout.log_capacity(n)
    ledger.reserve(entry, "log", (rows,), layout.LOG_ROW)
    ledger.reserve(file[layout.PATTERNS], "images", shown.shape, shown.dtype)
    ledger.reserve(file[layout.DATA], "images", (n, *c.frame_shape), np.dtype("u2"))
    images = file[layout.DATA]["images"]
    images.attrs.update({"units": "DN", "interpretation": "image"})
    for axis, name in zip(images.dims, layout.AXES, strict=True):
        axis.label = name
    file.flush()
    front = file.id.get_filesize() + _COPY_STRUCTURE
    large = rows * layout.LOG_ROW.itemsize + shown.nbytes + images.nbytes
    ledger.reserve(entry, "copy", (room_for_copy(front, large),), np.dtype("u1"))
    # HDF5 gives the names of many objects their place only now.
    file.flush()
    write_empty(entry["log"])
    file[layout.SHOWN_IMAGES][:] = shown
    ledger.note(layout.SHOWN_IMAGES, shown)
    # The first value takes the place of all.
    images[0, 0, 0] = 0
    entry["copy"][0] = 0
