"""Find the frames of a truncated record of format 2, whose places only HDF5's last bytes told.

The headers of its datasets stand near the file's beginning, and tell types, shapes and texts. From
them the same structure is written once more. HDF5 places data in the same way each time, so if all
headers and texts that are left come to lie where they are, the images do, too.
"""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Mapping, Sequence
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
from labapp.runs.record.datasets import allocate, reserve, write_text
from labapp.runs.record.object_headers import HeadedDataset, find_headed_datasets
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
        return _places_if_same(again, found)


def _places_if_same(again: Path, found: Mapping[str, HeadedDataset]) -> PlaceTable | None:
    """Return the places in a file that was written again, if they are those that were found."""
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
        allocate(entry, name, np.zeros(found[name].shape, found[name].dtype))
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
        allocate(data, name, np.zeros(shape[0], kinds[name]))
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
