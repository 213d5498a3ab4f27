"""Find the frames of a truncated record of format 2, whose places only HDF5's last bytes told.

The headers of its datasets stand near the file's beginning, and tell types, shapes and texts. From
them the same structure is written once more. HDF5 places data in the same way each time, so if all
headers and texts that are left come to lie where they are, the images do, too.

HDF5 writes the names of many objects at the end of a file, which a truncated one has lost. Headers:
see the HDF5 File Format Specification, version 3.0, IV.A.1.b (headers), IV.A.2.b (dataspace), d
(datatype), i (layout).
"""

from __future__ import annotations

import math
import mmap
import re
import struct
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

import labapp
from labapp.common.errors import UserError
from labapp.files.hdf5_output import create_group
from labapp.files.plain_hdf5 import open_hdf5
from labapp.files.plan_file import ROLES, PlanFile
from labapp.files.reading import validate
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.record import layout
from labapp.runs.record.datasets import reserve, write_text
from labapp.runs.record.place_table import PlaceTable, find_places
from labapp.runs.steps import planned_shots

_TEXTS = (
    "title", "definition", "start_time", "plan", "bench", "scene", "effect_plan", "pictures",
    "faults", "clock", "versions",
)  # fmt: skip
"""Texts of the entry, in the order in which they were written."""

_DEVICES = ("slm", "filter", "camera", "targets")

_SCALARS = ("seed", "expected_seconds", "state", "message", "end_time", "writer", "log")

_PATTERNS = ("images", "names", "first", "frames", "frame_time", "sha256")

_IDENTITY = ("model", "serial", "simulated")

_ORDER = (
    *_TEXTS, *_SCALARS,
    *(f"instrument/{device}/{name}" for device in _DEVICES for name in _IDENTITY),
    *(f"patterns/{name}" for name in _PATTERNS), "targets/names", "data/images",
)  # fmt: skip
"""Datasets of the entry, in the order in which they were made; the columns came after them."""

_FORMAT_MARK = b"labapp_format"


def rebuild_places(path: Path) -> PlaceTable | None:
    """Return the places in a truncated file of format 2; None if they aren't surely the same."""
    with path.open("rb") as file:
        try:
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except ValueError:
            return None
        with data:
            found = _first_datasets(data)
            return None if found is None else _rebuild(path.parent, data, found)


def _first_datasets(data: mmap.mmap) -> dict[str, HeadedDataset] | None:
    """Return the datasets by name, up to the images; None if they aren't all there."""
    if not data[:4096].count(_FORMAT_MARK):
        return None
    named = dict(zip(_ORDER, find_headed_datasets(data), strict=False))
    images = named.get("data/images")
    if images is None or len(images.shape) != 3 or images.dtype != np.dtype("u2"):
        return None
    return named


def _rebuild(
    folder: Path, data: mmap.mmap, found: Mapping[str, HeadedDataset]
) -> PlaceTable | None:
    """Write the structure again; return its places if all is where it was."""
    with tempfile.TemporaryDirectory(dir=folder, prefix=".salvage-") as scratch:
        again = Path(scratch, "structure.h5")
        try:
            with h5py.File(again, "w", libver="latest", locking=False) as file:
                _write_structure(file, data, found)
        except (ValueError, TypeError, OverflowError):
            return None
        with again.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as new:
            there = _first_datasets(new)
        if there is None or not all(_lies_as(one, there[name]) for name, one in found.items()):
            return None
        with open_hdf5(again) as file:
            return find_places(file, again.stat().st_size)


def _lies_as(one: HeadedDataset, other: HeadedDataset) -> bool:
    """Return whether two datasets have the same header and place, as far as they are told."""
    same = (one.header, one.shape, one.dtype) == (other.header, other.shape, other.dtype)
    return same and one.offset in (other.offset, None)


def _write_structure(file: h5py.File, data: mmap.mmap, found: Mapping[str, HeadedDataset]) -> None:
    """Write the structure of format 2, step by step as it was written."""

    def read(name: str) -> NDArray[Any]:
        return found[name].read(data)

    def texts(name: str) -> list[str]:
        return [one.decode() for one in read(name).reshape(-1).tolist()]

    file.attrs.update(
        {
            "NX_class": "NXroot",
            "default": layout.ENTRY,
            "creator": "labapp",
            "creator_version": labapp.__version__,
            "labapp_format": layout.UNPROTECTED_FORMAT,
        }
    )
    entry = create_group(file, layout.ENTRY, "NXentry")
    entry.attrs["default"] = "data"
    for name in _TEXTS:
        write_text(entry, name, texts(name)[0])
    entry["seed"] = int(read("seed"))
    entry["expected_seconds"] = float(read("expected_seconds"))
    for name in ("state", "message", "end_time", "writer", "log"):
        entry.create_dataset(name, data=np.zeros(found[name].shape, found[name].dtype))
    instrument = create_group(entry, "instrument", "NXinstrument")
    for name in _DEVICES:
        device = create_group(instrument, name, "NXdetector" if name == "camera" else "NXobject")
        for one in ("model", "serial"):
            write_text(device, one, texts(f"instrument/{name}/{one}")[0])
        device["simulated"] = bool(read(f"instrument/{name}/simulated"))
    patterns = create_group(file, layout.PATTERNS, "NXcollection")
    patterns["images"] = read("patterns/images")
    write_text(patterns, "names", texts("patterns/names"))
    patterns["first"] = read("patterns/first")
    patterns["frames"] = read("patterns/frames").tolist()
    patterns["frame_time"] = read("patterns/frame_time").tolist()
    patterns["frame_time"].attrs["units"] = "s"
    write_text(patterns, "sha256", texts("patterns/sha256"))
    targets = create_group(file, "entry/targets", "NXcollection")
    write_text(targets, "names", texts("targets/names"))
    _write_data(file, found["data/images"].shape)


def _write_data(file: h5py.File, shape: tuple[int, ...]) -> None:
    """Write the group of the frames, and their columns without content."""
    data = create_group(file, layout.DATA, "NXdata")
    data.attrs.update({"signal": "images", "axes": list(layout.AXES)})
    reserve(data, "images", shape, np.dtype("u2"))
    data["images"].attrs.update({"units": "DN", "interpretation": "image"})
    for name, size in (("y", shape[1]), ("x", shape[2])):
        data[name] = np.zeros(size)
    kinds = layout.PLANNED | layout.MEASURED
    for name in (*layout.planned_names(()), *layout.MEASURED):
        data.create_dataset(name, data=np.zeros(shape[0], kinds[name]))
    for name, unit in layout.UNITS.items():
        data[name].attrs["units"] = unit
    data["role"].attrs["names"] = list(ROLES)
    for axis, name in zip(data["images"].dims, layout.AXES, strict=True):
        axis.label = name


def planned_by_older_plan(
    plan: Any, bench: Any, targets: Sequence[str], patterns: Sequence[str], video_frame: float
) -> dict[str, NDArray[Any]] | None:
    """Return the planned columns that follow from a plan of format 2.

    None if they don't follow: the plan is lost, or asks for slots that the bench doesn't tell.

    video_frame: seconds.
    """
    try:
        shots = planned_shots(
            validate(plan, PlanFile, "plan"), _capabilities(bench, targets, video_frame)
        )
        return layout.planned_columns(shots, targets, patterns)
    except (UserError, TypeError, ValueError, IndexError):
        return None


def _capabilities(bench: Any, targets: Sequence[str], video_frame: float) -> BenchCapabilities:
    """Return as much of a bench's capabilities as settings depend on; times are left out."""
    described = bench["devices"]["filter"] if bench else {}
    slots = described.get("options", described).get("slots_nm", ())
    return BenchCapabilities(
        targets=tuple(targets),
        by_hand=False,
        wavelength_range=(0.0, np.inf),
        slots=tuple(round(slot[0] * 1e3) * 1e-12 for slot in slots),
        exposure_range=(0.0, np.inf),
        frame_shape=(1, 1),
        panel_shape=(1, 1),
        video_frame=video_frame,
        readout=0.0,
        target_settling=0.0,
        slm_settling=0.0,
        filter_settling=0.0,
    )


_SIGNATURE = b"OHDR\x02"

_DATASPACE, _DATATYPE, _LAYOUT = 1, 3, 8
"""Kinds of messages."""

_TIMES, _PHASES, _ORDERED = 0x20, 0x10, 0x04
"""Bits of a header: it has times, limits of its attributes, numbers of its messages."""

_CONTIGUOUS = 1
_UNDEFINED = (1 << 64) - 1

_ENCODED_TYPE = b"\x03\x00"
"""What H5Tencode() writes before a datatype: the kind of message and a version."""

_MOST_AXES = 3


@dataclass(frozen=True)
class HeadedDataset:
    """A dataset that its header tells.

    header: where that begins, bytes.
    offset: of its data, bytes; None if it isn't told.
    """

    header: int
    shape: tuple[int, ...]
    dtype: np.dtype
    offset: int | None

    def read(self, data: bytes | mmap.mmap) -> NDArray[Any]:
        """Read the values from the bytes of the file; raise ValueError if they end before."""
        size = math.prod(self.shape) * self.dtype.itemsize
        part = data[self.offset : self.offset + size] if self.offset is not None else b""
        return np.frombuffer(part, self.dtype).reshape(self.shape)


def find_headed_datasets(data: bytes | mmap.mmap) -> Iterator[HeadedDataset]:
    """Yield the contiguous datasets whose headers are in the first bytes of a file.

    They come in the order of their headers, which is that in which they were made.
    """
    for match in re.finditer(_SIGNATURE, data):
        found = _read_header(data, match.start())
        if found is not None:
            yield found


def _read_header(data: bytes | mmap.mmap, start: int) -> HeadedDataset | None:
    """Return the dataset whose header begins there; None if it isn't the header of one."""
    try:
        messages = dict(_messages(data, start))
        shape = _shape(messages[_DATASPACE])
        dtype = h5py.h5t.decode(_ENCODED_TYPE + messages[_DATATYPE]).dtype
        offset = _offset(messages[_LAYOUT]) if _LAYOUT in messages else None
    except (KeyError, ValueError, TypeError, RuntimeError, struct.error, IndexError):
        return None
    return HeadedDataset(start, shape, np.dtype(dtype), offset)


def _messages(data: bytes | mmap.mmap, start: int) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the messages in the first part of an object's header."""
    flags = data[start + 5]
    at = start + 6 + 16 * bool(flags & _TIMES) + 4 * bool(flags & _PHASES)
    width = 1 << (flags & 3)
    size = int.from_bytes(data[at : at + width], "little")
    at += width
    end = min(at + size, len(data))
    head = 6 if flags & _ORDERED else 4
    while at + head <= end:
        kind, length = data[at], int.from_bytes(data[at + 1 : at + 3], "little")
        yield kind, data[at + head : at + head + length]
        at += head + length


def _shape(message: bytes) -> tuple[int, ...]:
    """Return the shape that a dataspace message of version 2 tells."""
    version, axes = message[0], message[1]
    if version != 2 or axes > _MOST_AXES:
        raise ValueError("not a dataspace of a record")
    return struct.unpack_from(f"<{axes}Q", message, 4)


def _offset(message: bytes) -> int:
    """Return the position that a layout message of version 3 or 4 tells of data in one piece."""
    version, kind, offset = struct.unpack_from("<BBQ", message)
    if version not in (3, 4) or kind != _CONTIGUOUS or offset == _UNDEFINED:
        raise ValueError("not data in one piece")
    return offset
