"""Find the frames that are whole in a damaged or truncated record, and what else it still tells.

A record of format 3 or later is read by its table of places, without HDF5: frames are whole if
their image has the digest of its link. Of what was known before the first frame, each dataset is
kept that has its digest. If the table itself is damaged, or the format is older, HDF5 tells the
places; a truncated file is read from a copy that is padded with zeros. Frames of the older format
are whole if they have their checksum; where that is cut off, if all of their bytes are there.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Identity
from labapp.common.errors import UserError
from labapp.files.frame_list import format_frame_list
from labapp.files.guarded_reading import unreadable
from labapp.files.plain_hdf5 import explain_system_error, open_hdf5
from labapp.files.plan_file import ROLES
from labapp.runs.readouts import AS_OPENED, Readout
from labapp.runs.record import layout
from labapp.runs.record.chain import AT_ONCE
from labapp.runs.record.creation import RecordContents
from labapp.runs.record.digests import unpack_settings
from labapp.runs.record.older_format import planned_by_older_plan, rebuild_places
from labapp.runs.record.place_table import PlaceTable, TableError, find_places
from labapp.runs.record.record_file import require_plain_structure, stored_file_size
from labapp.runs.record.repair import planned_from_texts, proved_table
from labapp.runs.record.second_copy import choose_places, read_either_table
from labapp.runs.record.whole_frames import WholeFrames
from labapp.runs.shots import ShotList, ShotTarget
from optics.progress import Progress

_UNKNOWN_GAIN = 1.0
"""Gain in electrons per DN if neither the record nor its bench tells it: digital numbers stay."""

_JSON = ("plan", "bench", "scene", "effect_plan", "pictures", "faults", "capabilities")


@dataclass
class Remains:
    """What a damaged record still tells.

    contents: to make a new record from. whole: indices of frames that are whole with their
    settings. lacks: what is lost, in words.
    """

    contents: RecordContents
    whole: list[int] = field(default_factory=list)
    lacks: list[str] = field(default_factory=list)


class DamagedRecord:
    """Reads what is whole in a damaged record; see `open_damaged`."""

    def __init__(self, path: Path, handle: int, table: PlaceTable, form: int) -> None:
        self._path, self._handle, self._table, self._format = path, handle, table, form
        self._frames = WholeFrames(handle, table)
        self._lacks: list[str] = []

    def find_remains(self, progress: Progress) -> Remains:
        """Find the frames that are whole, and what a new record can be made from."""
        self._planned = self._planned_columns()
        contents = self._contents(self._planned)
        if self._format == layout.UNPROTECTED_FORMAT:
            self._frames.find_summed()
        else:
            self._frames.find_linked(progress)
        whole, known = self._frames.whole, self._frames.known
        found = Remains(contents, np.flatnonzero(whole).tolist())
        lost = [] if whole.all() else [f"frames {format_frame_list(np.flatnonzero(~whole))}"]
        found.lacks = [*lost, *self._lacks, *self._frames.lacks]
        if unknown := np.flatnonzero(whole & ~known).tolist():
            which = f" of frames {format_frame_list(unknown)}" if (whole & known).any() else ""
            found.lacks.append(f"the measured settings{which}, those that were planned instead")
        return found

    def frame(self, index: int) -> tuple[NDArray[np.uint16], dict[str, Any]]:
        """Return the image of a frame, and its measured columns by name."""
        place, data = self._table.places[f"{layout.DATA}/images"], self._frames.image_bytes(index)
        image = np.frombuffer(data, place.dtype).reshape(place.shape[1:])
        if self._frames.known[index]:
            return image, unpack_settings(self._frames.values[index].tobytes())
        return image, {name: column[index] for name, column in self._planned_settings.items()}

    @cached_property
    def _planned_settings(self) -> dict[str, NDArray[Any]]:
        """The measured columns as they were planned."""
        bench, exposures = self._json_or_none("bench") or {}, self._planned["exposure_asked"]
        count = len(exposures)
        gain = (bench.get("sensor") or {}).get("gain_electrons_per_dn", _UNKNOWN_GAIN)
        return {
            "exposure": exposures,
            "wavelength": self._planned["wavelength_asked"],
            "gain": np.full(count, gain),
            "time": np.cumsum(exposures) - exposures,
            "timestamp": np.full(count, self._path.stat().st_mtime),
            "number": np.arange(count),
            "attempts": np.ones(count, np.uint16),
            "checksum": np.zeros(count, np.uint32),
        }

    def log_lines(self) -> Iterator[tuple[float, str]]:
        """Yield bench time in seconds and text of the lines of the log that can be read."""
        with suppress(TableError, KeyError):
            for rows in self._table.read_blocks(self._handle, "entry/log", AT_ONCE):
                for time, text in ((float(row["time"]), bytes(row["text"])) for row in rows):
                    if text and time == time:
                        yield time, text.decode(errors="replace")

    def _read_or_none(self, name: str) -> NDArray[Any] | None:
        """Read a dataset; None if it is cut off, or isn't there."""
        try:
            return self._table.read(self._handle, name)
        except (TableError, KeyError):
            return None

    def _read_known(self, name: str) -> NDArray[Any] | None:
        """Read a dataset that was known before the first frame, if it is as it was."""
        found = self._read_or_none(name)
        if found is None or not self._table.places[name].digest:
            return found
        return found if self._table.is_whole(self._handle, name) else None

    def _planned_columns(self) -> dict[str, NDArray[Any]]:
        """Return the planned columns, or what the plan makes of them."""
        expected = layout.planned_names(self._table.places)
        found = {name: self._read_known(f"{layout.DATA}/{name}") for name in expected}
        whole = {name: column for name, column in found.items() if column is not None}
        if len(whole) == len(found):
            return whole
        again = self._columns_of_plan()
        if again is not None:
            return again
        there = {name: self._read_or_none(f"{layout.DATA}/{name}") for name in expected}
        left = {name: column for name, column in there.items() if column is not None}
        if len(left) < len(there):
            raise UserError(
                f"{self._path}: neither the plan nor the columns that follow from it are there, so "
                "nothing tells what the frames are of. Restore the file from a copy."
            )
        lost = ", ".join(sorted(set(there) - set(whole)))
        self._lacks.append(f"the proof of what was planned ({lost}): frames may be of others")
        counts = {"role": len(ROLES)}
        for kind in ("target", "pattern"):
            names = self._read_known(f"entry/{kind}s/names")
            counts[kind] = len(names) if names is not None else 1 + int(left[kind].max())
        return left | {name: np.minimum(left[name], count - 1) for name, count in counts.items()}

    def _columns_of_plan(self) -> dict[str, NDArray[Any]] | None:
        """Return the planned columns that follow from the plan."""
        if self._format != layout.UNPROTECTED_FORMAT:
            return planned_from_texts(self._handle, self._table, self._path)
        times = self._read_known(f"{layout.PATTERNS}/frame_time")
        targets, patterns = (
            self._read_known(f"entry/{one}s/names") for one in ("target", "pattern")
        )
        if times is None or targets is None or patterns is None:
            return None
        return planned_by_older_plan(
            self._json_or_none("plan"),
            self._json_or_none("bench"),
            [name.decode() for name in targets.tolist()],
            [name.decode() for name in patterns.tolist()],
            float(times.max()),
        )

    def _contents(self, columns: Mapping[str, NDArray[Any]]) -> RecordContents:
        """Return what a new record is made from; what is lost is left empty."""
        texts = {name: self._json(name) for name in _JSON}
        names = self._names("entry/targets/names", columns["target"], "target")
        patterns = self._patterns(columns["pattern"])
        shown = {
            "index": np.arange(len(columns["frame"])),
            "wavelength": columns["wavelength_asked"],
            "exposure": columns["exposure_asked"],
        }
        shots = ShotList(
            {**columns, **shown},
            [ShotTarget(name) for name in names],
            list(patterns),
            self._readouts(columns.get("readout")),
        )
        x = self._read_known(f"{layout.DATA}/x")
        times = self._read_known(f"{layout.PATTERNS}/frame_time")
        seed = self._read_known("entry/seed")
        _, rows, pixels = self._table.places[f"{layout.DATA}/images"].shape
        return RecordContents(
            title=self._text("title") or self._path.stem,
            seed=int(seed) if seed is not None else 0,
            plan=texts["plan"] or {},
            bench=texts["bench"] or {},
            scene=texts["scene"],
            effect_plan=texts["effect_plan"],
            identities=self._identities(),
            targets=names,
            patterns=patterns,
            shots=shots,
            frame_shape=(rows, pixels),
            pixel_pitch=float(x[1] - x[0]) if x is not None and len(x) > 1 else 1.0,
            video_frame=float(times.max()) if times is not None else 0.0,
            pictures=texts["pictures"] or {},
            faults=texts["faults"] or [],
            clock=self._text("clock") or "real",
            capabilities=texts["capabilities"] or {},
        )

    def _text(self, name: str) -> str | None:
        """Return a text; None if it is lost."""
        found = self._read_known(f"entry/{name}")
        try:
            return None if found is None else bytes(found[()]).decode()
        except UnicodeDecodeError:
            return None

    def _json(self, name: str) -> Any:
        """Return plain data; None if they are lost, which is noted."""
        if name == "capabilities" and self._format == layout.UNPROTECTED_FORMAT:
            return None
        found = self._json_or_none(name)
        if found is None and self._text(name) != "null":
            self._lacks.append(f"the {name.replace('_', ' ')}")
        return found

    def _json_or_none(self, name: str) -> Any:
        """Return plain data; None if they are lost, or are null."""
        try:
            return json.loads(self._text(name) or "")
        except ValueError:
            return None

    def _names(self, name: str, indices: NDArray[Any], kind: str) -> list[str]:
        """Return names; if they are lost, numbers instead."""
        found = self._read_known(name)
        if found is not None:
            return [one.decode(errors="replace") for one in found.tolist()]
        self._lacks.append(f"the names of the {kind}s")
        return [f"{kind} {number}" for number in range(int(indices.max()) + 1)]

    def _readouts(self, indices: NDArray[Any] | None) -> list[Readout]:
        """Return how the sensor was read; if that is lost, as the bench opened it."""
        if indices is None:
            return [AS_OPENED]
        told = self._json("readouts")
        if told is not None:
            return [Readout.of_data(one) for one in told]
        return [AS_OPENED] * (int(indices.max(initial=0)) + 1)

    def _patterns(self, indices: NDArray[Any]) -> dict[str, NDArray[np.uint8]]:
        """Return the patterns by name; those that are lost are black."""
        names = self._names(f"{layout.PATTERNS}/names", indices, "pattern")
        first, count, times = (
            self._read_known(f"{layout.PATTERNS}/{name}")
            for name in ("first", "frames", "frame_time")
        )
        images = self._read_or_none(layout.SHOWN_IMAGES)
        if first is None or count is None or times is None or images is None:
            self._lacks.append("the patterns, black instead")
            shape = self._table.places[layout.SHOWN_IMAGES].shape[1:]
            return {name: np.zeros(shape, np.uint8) for name in names}
        if self._read_known(layout.SHOWN_IMAGES) is None:
            self._lacks.append("the patterns as they were shown")
        shown = {}
        for name, begin, length, time in zip(names, first, count, times, strict=True):
            part = images[int(begin) : int(begin + length)].copy()
            shown[name] = part if time else part[0]
        return shown

    def _identities(self) -> dict[str, Identity]:
        """Return the devices that are still known."""
        names = {
            name.split("/")[2]
            for name in self._table.places
            if name.startswith("entry/instrument/")
        }
        found = {}
        for name in sorted(names):
            model, serial = (self._text(f"instrument/{name}/{one}") for one in ("model", "serial"))
            simulated = self._read_known(f"entry/instrument/{name}/simulated")
            if model is None or serial is None or simulated is None:
                self._lacks.append(f"what the {name} was")
                continue
            found[name] = Identity(model, serial, simulated=bool(simulated))
        return found


@contextmanager
def open_damaged(path: Path) -> Iterator[DamagedRecord]:
    """Open a damaged record for salvage; raise UserError if nothing tells its places."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise unreadable(path, error) from error
    try:
        table, form = _find_table(path, handle)
        table = choose_places(handle, table)
        yield DamagedRecord(path, handle, table, form)
    finally:
        os.close(handle)


def _find_table(path: Path, handle: int) -> tuple[PlaceTable, int]:
    """Return the places of the datasets, and the number of the format."""
    try:
        return read_either_table(handle), layout.FORMAT
    except TableError:
        table = proved_table(path, handle)
    if table is not None:
        return table, layout.FORMAT
    try:
        return _places_by_hdf5(path)
    except UserError as error:
        table = rebuild_places(path)
        if table is None:
            raise UserError(
                f"{path}: nothing tells where its frames are: neither a table of places, nor "
                "HDF5, nor the headers of its datasets. Restore the file from a copy."
            ) from error
        return table, layout.UNPROTECTED_FORMAT


def _places_by_hdf5(path: Path) -> tuple[PlaceTable, int]:
    """Return the places of the datasets as HDF5 tells them, and the number of the format."""
    with _openable(path) as whole:
        try:
            with open_hdf5(whole) as file:
                form = int(file.attrs.get("labapp_format", 0))
                require_plain_structure(file, whole)
                table = find_places(file, whole.stat().st_size)
        except (OSError, RuntimeError, KeyError, ValueError) as error:
            if (told := explain_system_error(error)) is not None:
                raise UserError(f"{path}: {told}") from error
            raise UserError(
                f"{path}: neither its table of places nor HDF5 tells where the frames are "
                f"({error}). Restore the file from a copy."
            ) from error
    if form not in (*layout.PROTECTED_FORMATS, layout.UNPROTECTED_FORMAT):
        raise UserError(f"{path}: is not a record of a run. Give one that `labapp run` wrote.")
    return table, form


@contextmanager
def _openable(path: Path) -> Iterator[Path]:
    """Yield the file, or a copy padded with zeros to the length that HDF5 needs."""
    try:
        open_hdf5(path).close()
        yield path
    except OSError as error:
        sizes = stored_file_size(error)
        if sizes is None:
            told = explain_system_error(error)
            told = told or f"HDF5 can't open it: {error}. Restore it from a copy."
            raise UserError(f"{path}: {told}") from error
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            copy = Path(folder, path.name)
            shutil.copyfile(path, copy)
            os.truncate(copy, sizes)
            yield copy
