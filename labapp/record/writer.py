"""Writing a record: frame by frame, each on disk before it is acknowledged."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

import labapp
from drivers.interfaces import Frame, Identity
from labapp.acquisition.state import State
from labapp.acquisition.steps import Shot
from labapp.errors import UserError
from labapp.files.writing import require_writable
from labapp.record import layout, process

_PACKAGES = ("numpy", "scipy", "torch", "h5py")


@dataclass(frozen=True)
class Contents:
    """Everything about a run that is known before its first frame."""

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


class RecordWriter:
    """A record being written; a context manager that closes the file however it ends.

    path: the file. force: whether an existing file may be replaced. The new file takes
    its name only when it is ready for the first frame, so that nothing half-made is left
    and nothing is lost if it can't be made. UserError says why it can't.
    """

    def __init__(self, path: Path, contents: Contents, *, force: bool = False) -> None:
        require_writable(path, force=force)
        self.path = path
        self._contents = contents
        self._log_length = 0
        draft = path.with_name(f".{path.name}.{os.getpid()}.new")
        try:
            self._file = h5py.File(draft, "w", libver="latest")
            try:
                self._prepare()
                self._file.swmr_mode = True
                os.replace(draft, path)
            except BaseException:
                self._file.close()
                raise
        except OSError as error:
            with contextlib.suppress(OSError):
                draft.unlink()
            raise UserError(f"{path}: cannot be written: {error}. Choose another place.") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        if self._file:
            self._file.close()

    def store(self, shot: Shot, frame: Frame, wavelength: float) -> None:
        """Put a frame on disk; when this returns, it survives the end of this process."""
        data = self._file[layout.DATA]
        values = {
            "exposure": frame.exposure,
            "wavelength": wavelength,
            "gain": frame.gain,
            "time": frame.time,
            "checksum": checksum(frame.image),
        }
        data["images"][shot.index] = frame.image
        for name, value in values.items():
            data[name][shot.index] = value
        self._file.flush()
        data["stored"][shot.index] = 1
        self._file.flush()

    def log(self, time: float, text: str) -> None:
        """Add a line to the log; when the log is full, its last line is overwritten."""
        rows = self._file["entry/log"]
        row = np.array((time, text.encode()[:200]), dtype=layout.LOG_ROW)
        rows[min(self._log_length, len(rows) - 1)] = row
        self._log_length += 1
        self._file.flush()

    def set_state(self, state: State, message: str = "") -> None:
        self._file["entry/state"][0] = state.value.encode()
        self._file["entry/message"][0] = message.encode()[:400]
        if state not in (State.PLANNED, State.RUNNING, State.PAUSED):
            self._file["entry/end_time"][0] = _now().encode()
        self._file.flush()

    def _prepare(self) -> None:
        c, file = self._contents, self._file
        file.attrs.update(
            {
                "NX_class": "NXroot",
                "default": layout.ENTRY,
                "creator": "labapp",
                "creator_version": labapp.__version__,
                "labapp_format": layout.FORMAT,
            }
        )
        entry = _group(file, layout.ENTRY, "NXentry")
        entry.attrs["default"] = "data"
        entry["title"], entry["definition"] = c.title, "labapp_run"
        entry["seed"], entry["start_time"], entry["writer"] = c.seed, _now(), process.me()
        for name in ("plan", "bench", "scene", "effect_plan"):
            entry[name] = json.dumps(getattr(c, name))
        entry["versions"] = json.dumps(_versions())
        entry.create_dataset("state", data=np.array([b"PLANNED"], layout.STATE_TYPE))
        entry.create_dataset("message", (1,), layout.MESSAGE_TYPE)
        entry.create_dataset("end_time", (1,), np.dtype("S40"))
        entry.create_dataset("log", (layout.log_rows(len(c.shots)),), layout.LOG_ROW)
        instrument = _group(entry, "instrument", "NXinstrument")
        for name, identity in c.identities.items():
            kind = "NXdetector" if name == "camera" else "NXobject"
            device = _group(instrument, name, kind)
            device["model"], device["serial"] = identity.model, identity.serial
            device["simulated"] = identity.simulated
        self._prepare_patterns()
        self._prepare_data()

    def _prepare_patterns(self) -> None:
        patterns, c = _group(self._file, layout.PATTERNS, "NXcollection"), self._contents
        patterns["images"] = np.stack(list(c.patterns.values()))
        patterns["names"] = list(c.patterns)
        patterns["sha256"] = [sha256(image.tobytes()).hexdigest() for image in c.patterns.values()]
        targets = _group(self._file, "entry/targets", "NXcollection")
        targets["names"] = list(c.targets)

    def _prepare_data(self) -> None:
        data, c = _group(self._file, layout.DATA, "NXdata"), self._contents
        n, (rows, columns) = len(c.shots), c.frame_shape
        data.attrs.update({"signal": "images", "axes": ["frame", "y", "x"]})
        images = data.create_dataset("images", (n, rows, columns), "u2", chunks=(1, rows, columns))
        images.attrs["units"] = "DN"
        for name, size in (("y", rows), ("x", columns)):
            data[name] = (np.arange(size) - size // 2) * c.pixel_pitch
        for name, dtype in layout.COLUMNS.items():
            data.create_dataset(name, (n,), dtype)
        for name, unit in layout.UNITS.items():
            data[name].attrs["units"] = unit
        names, targets = list(c.patterns), list(c.targets)
        planned = {
            "frame": [s.index for s in c.shots],
            "step": [s.step for s in c.shots],
            "repeat": [s.repeat for s in c.shots],
            "target": [targets.index(s.target) for s in c.shots],
            "pattern": [names.index(s.pattern) for s in c.shots],
            "exposure_asked": [s.exposure for s in c.shots],
            "wavelength_asked": [s.wavelength for s in c.shots],
        }
        for name, values in planned.items():
            data[name][:] = values


def mark(path: Path, state: State, message: str = "") -> None:
    """Set the state of a record that is closed."""
    with h5py.File(path, "r+", libver="latest") as file:
        file["entry/state"][0] = state.value.encode()
        file["entry/message"][0] = message.encode()[:400]
        file["entry/end_time"][0] = _now().encode()


def checksum(image: NDArray[np.uint16]) -> int:
    return zlib.crc32(np.ascontiguousarray(image).data)


def _group(parent: h5py.Group, name: str, kind: str) -> h5py.Group:
    group = parent.create_group(name)
    group.attrs["NX_class"] = kind
    return group


def _versions() -> dict[str, str]:
    found = {name: version(name) for name in _PACKAGES}
    return {"labapp": labapp.__version__, "python": platform.python_version(), **found}


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
