"""Reading a record, also while it is written and after its writer was killed."""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from labapp.acquisition.state import ENDED, State
from labapp.errors import UserError
from labapp.files.bench_file import BenchFile
from labapp.files.plan_file import PlanFile
from labapp.files.reading import validate
from labapp.files.scene_file import SceneFile
from labapp.record import layout, process
from labapp.record.writer import checksum


class Record:
    """A record opened for reading; a context manager.

    UserError if the file isn't a record of this application.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise UserError(f"{path}: there is no such file. Check the path.")
        try:
            self._file = h5py.File(path, "r")
        except OSError as error:
            raise UserError(f"{path}: is not an HDF5 file. Give a record of a run.") from error
        written = self._file.attrs.get("labapp_format")
        if written != layout.FORMAT:
            self.close()
            raise UserError(
                f"{path}: is not a record of format {layout.FORMAT} (found {written}). "
                "Give a record that `labapp run` or `labapp demo` wrote."
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._file.close()

    @property
    def state(self) -> State:
        """As written; INTERRUPTED if it was running and its writer is gone."""
        written = State(self._file["entry/state"][0].decode())
        if written not in ENDED and not process.is_alive(self.writer):
            return State.INTERRUPTED
        return written

    @property
    def writer(self) -> str:
        """Who wrote last: host, process, start of the process, as JSON."""
        return self._file["entry/writer"][0].decode()

    @property
    def message(self) -> str:
        return self._file["entry/message"][0].decode(errors="replace")

    @property
    def plan(self) -> PlanFile:
        return validate(json.loads(self.text("plan")), PlanFile, f"{self.path}: plan")

    @property
    def bench(self) -> BenchFile:
        return validate(json.loads(self.text("bench")), BenchFile, f"{self.path}: bench")

    @property
    def scene(self) -> SceneFile | None:
        """The scene before simulated devices, None for a real one."""
        data = json.loads(self.text("scene"))
        return None if data is None else validate(data, SceneFile, f"{self.path}: scene")

    @property
    def effect_plan(self) -> dict[str, Any] | None:
        return json.loads(self.text("effect_plan"))

    @property
    def versions(self) -> dict[str, str]:
        return json.loads(self.text("versions"))

    @property
    def devices(self) -> dict[str, dict[str, Any]]:
        group = self._file["entry/instrument"]
        return {
            name: {
                "model": device["model"][()].decode(),
                "serial": device["serial"][()].decode(),
                "simulated": bool(device["simulated"][()]),
            }
            for name, device in group.items()
        }

    @property
    def simulated(self) -> list[str]:
        return [name for name, device in self.devices.items() if device["simulated"]]

    def text(self, name: str) -> str:
        """A scalar string of the entry: title, start_time, plan, ..."""
        return self._file[f"entry/{name}"][()].decode()

    @property
    def end_time(self) -> str:
        return self._file["entry/end_time"][0].decode()

    @property
    def seed(self) -> int:
        return int(self._file["entry/seed"][()])

    @property
    def target_names(self) -> list[str]:
        return [name.decode() for name in self._file["entry/targets/names"][()]]

    @property
    def pattern_names(self) -> list[str]:
        return [name.decode() for name in self._file["entry/patterns/names"][()]]

    def pattern(self, name: str) -> NDArray[np.uint8]:
        """Grey levels (rows, columns) of a still, (frames, rows, columns) of a video."""
        group, index = self._file[layout.PATTERNS], self.pattern_names.index(name)
        first, count = int(group["first"][index]), int(group["frames"][index])
        frames = group["images"][first : first + count]
        return frames if group["frame_time"][index] else frames[0]

    @property
    def expected_seconds(self) -> float:
        """Of bench time, settling included, if nothing goes wrong."""
        return float(self._file["entry/expected_seconds"][()])

    @property
    def faults(self) -> list[dict[str, Any]]:
        """The faults that a virtual bench was asked to have."""
        return json.loads(self.text("faults"))

    @property
    def pictures(self) -> dict[str, str]:
        """SHA-256 of the picture files of a simulated scene, by path."""
        return json.loads(self.text("pictures"))

    def column(self, name: str) -> NDArray[Any]:
        """One value a planned frame; see labapp.record.layout."""
        return self._file[f"{layout.DATA}/{name}"][()]

    def image(self, index: int) -> NDArray[np.uint16]:
        return self._file[f"{layout.DATA}/images"][index]

    @property
    def frames(self) -> int:
        return int(self._file[f"{layout.DATA}/images"].shape[0])

    @property
    def log(self) -> list[tuple[float, str]]:
        rows = self._file["entry/log"][()]
        return [(float(r["time"]), r["text"].decode(errors="replace")) for r in rows if r["text"]]

    def not_stored(self) -> list[int]:
        """Indices of planned frames that were never acknowledged."""
        return np.flatnonzero(self.column("stored") == 0).tolist()

    def missing(self) -> list[int]:
        """Indices of planned frames that aren't stored, or don't read back as they were."""
        stored, sums = self.column("stored"), self.column("checksum")
        return [
            index
            for index in range(self.frames)
            if not stored[index] or checksum(self.image(index)) != sums[index]
        ]

    def select(self, **wanted: Any) -> list[int]:
        """Indices of stored frames by target, pattern, exposure_asked, wavelength_asked."""
        names = {"target": self.target_names, "pattern": self.pattern_names}
        keep = self.column("stored").astype(bool)
        for column, value in wanted.items():
            known = names.get(column)
            if known is not None:
                if value not in known:
                    return []
                value = known.index(value)
            keep &= self.column(column) == value
        return np.flatnonzero(keep).tolist()

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every array of the record that plan, seed and bench decide, by its path.

        What differs from run to run of the same plan is left out: wall-clock times, log,
        the camera's own count, how often a frame was tried.
        """
        found: dict[str, NDArray[Any]] = {}

        def collect(path: str, item: Any) -> None:
            group, _, name = path.rpartition("/")
            decided = group != layout.ENTRY and name not in layout.UNSEEDED
            if isinstance(item, h5py.Dataset) and item.shape and decided:
                found[path] = item[()]

        self._file.visititems(collect)
        return found


def digest(file: Path) -> str:
    """SHA-256 of a file in hexadecimals; empty if it can't be read."""
    try:
        return sha256(file.read_bytes()).hexdigest()
    except OSError:
        return ""
