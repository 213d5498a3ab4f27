"""What the record of a run tells: plan, bench, patterns, frames and log."""

from __future__ import annotations

from functools import cached_property
from hashlib import file_digest, sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.guarded_reading import open_regular
from labapp.files.plan_file import PlanFile
from labapp.files.reading import M, validate
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.readouts import AS_OPENED, Readout
from labapp.runs.record import layout, writer_process
from labapp.runs.record.record_file import RecordFile
from labapp.runs.state import State

if TYPE_CHECKING:
    # These are imported when they are needed, because they load all devices, lenses and scenes.
    from labapp.files.bench_file import BenchFile
    from labapp.files.scene_file import SceneFile
    from optics.camera import Camera


class Record(RecordFile):
    """A record of a run, opened for reading, also while it is written; a context manager.

    Every property and method raises UserError if the file is damaged.

    Parameters
    ----------
    path : Path
        File of the record.
    damaged : bool, default False
        Whether a record is opened whose structure has changed since it was made, to see what can
        still be read.
    readout : int, optional
        Number of a way of reading the sensor, from 0: only frames of it are selected. It is needed
        only where the run had several.

    Raises
    ------
    UserError
        If the file isn't a record of this application, its structure has changed, or it refers to
        other files.
    """

    def __init__(self, path: Path, *, damaged: bool = False, readout: int | None = None) -> None:
        super().__init__(path, damaged=damaged)
        self._known: dict[tuple[str, str], Any] = {}
        self._chosen = readout

    @property
    def state(self) -> State:
        """How the run stands; INTERRUPTED if the writing process is gone before the end."""
        with self._damage_as_user_error("entry/state"):
            written = State(self._single_text("state"))
        with self._damage_as_user_error("entry/writer"):
            gone = not written.has_ended and not writer_process.is_alive(self.writer)
        return State.INTERRUPTED if gone else written

    @property
    def writer(self) -> str:
        """The process that wrote last, as JSON: host, number and start."""
        return self._single_text("writer")

    @property
    def message(self) -> str:
        return self._read("entry/message")[0].decode(errors="replace")

    @property
    def plan(self) -> PlanFile:
        return self._validated("plan", PlanFile)

    @property
    def bench(self) -> BenchFile:
        """The bench file, with the clip level by which the frames were judged."""
        from labapp.runs.brackets.clip_remarks import bench_as_metered

        return bench_as_metered(self.bench_as_opened, self.plan)

    @property
    def bench_as_opened(self) -> BenchFile:
        """The bench file as it was at the start."""
        from labapp.files.bench_file import BenchFile

        return self._validated("bench", BenchFile)

    @property
    def scene(self) -> SceneFile | None:
        """The scene before simulated devices; None if the devices were real."""
        from labapp.files.scene_file import SceneFile

        data = self._json("scene")
        return None if data is None else validate(data, SceneFile, f"{self.path}: scene")

    @property
    def effect_plan(self) -> dict[str, Any] | None:
        return self._json("effect_plan")

    @property
    def versions(self) -> dict[str, str]:
        return self._json("versions")

    @property
    def devices(self) -> dict[str, dict[str, Any]]:
        with self._damage_as_user_error("entry/instrument"):
            return {
                name: {
                    "model": device["model"][()].decode(),
                    "serial": device["serial"][()].decode(),
                    "simulated": bool(device["simulated"][()]),
                }
                for name, device in self._file["entry/instrument"].items()
            }

    @property
    def simulated_devices(self) -> list[str]:
        return [name for name, device in self.devices.items() if device["simulated"]]

    @property
    def end_time(self) -> str:
        return self._single_text("end_time")

    @property
    def seed(self) -> int:
        return int(self._read("entry/seed"))

    @property
    def target_names(self) -> list[str]:
        return self._texts("entry/targets/names")

    @property
    def pattern_names(self) -> list[str]:
        return self._texts(f"{layout.PATTERNS}/names")

    def changed_patterns(self) -> list[str]:
        """Return the names of the patterns whose SHA-256 has changed since they were shown."""
        names = self.pattern_names
        known = dict(zip(names, self._texts(f"{layout.PATTERNS}/sha256"), strict=False))
        return [
            name
            for name in names
            if sha256(self.pattern(name).tobytes()).hexdigest() != known.get(name)
        ]

    def patterns(self) -> dict[str, NDArray[np.uint8]]:
        """Return all patterns by name; raise UserError if one has changed."""
        if changed := self.changed_patterns():
            raise UserError(
                f"{self.path}: the pattern {changed[0]!r} isn't as it was shown: the file is "
                "damaged. Run its plan again."
            )
        return {name: self.pattern(name) for name in self.pattern_names}

    def pattern(self, name: str) -> NDArray[np.uint8]:
        """Return a pattern's grey levels, (rows, columns); (frames, rows, columns) of a video."""
        index = self.pattern_names.index(name)
        with self._damage_as_user_error(layout.PATTERNS):
            group = self._file[layout.PATTERNS]
            first, count = int(group["first"][index]), int(group["frames"][index])
            frames = group["images"][first : first + count]
            return frames if group["frame_time"][index] else frames[0]

    @property
    def capabilities(self) -> BenchCapabilities | None:
        """What the bench could do; None in older formats."""
        if self.format == layout.UNPROTECTED_FORMAT or not (known := self._json("capabilities")):
            return None
        return BenchCapabilities.of_data(known)

    @property
    def closing_digest(self) -> str:
        """The digest over all, in hexadecimal; empty before the end."""
        if self.format == layout.UNPROTECTED_FORMAT:
            return ""
        digest = self._read(f"{layout.DIGESTS}/closing")[0]
        return bytes(digest).hex() if digest.any() else ""

    @property
    def expected_seconds(self) -> float:
        """Expected duration in seconds of bench time, settling included."""
        return float(self._read("entry/expected_seconds"))

    @property
    def faults(self) -> list[dict[str, Any]]:
        """The fault script of the virtual bench, as plain data."""
        return self._json("faults")

    @property
    def scene_picture_digests(self) -> dict[str, str]:
        """SHA-256 of the picture files of the simulated scene, by path."""
        return self._json("pictures")

    def image(
        self, index: int, rows: slice = slice(None), columns: slice = slice(None)
    ) -> NDArray[Any]:
        """Return a frame in DN, or some of its rows and columns.

        It is of uint16, or of float32 where it is the mean of several frames.
        """
        return self.readout_of(index).numbers(self.stored_image(index, rows, columns))

    def stored_image(
        self, index: int, rows: slice = slice(None), columns: slice = slice(None)
    ) -> NDArray[np.uint16]:
        """Return a frame, or a part, in the steps in which it is stored."""
        if not self._reads_plainly:
            # The row that holds it may have zeros behind it.
            height, width = self.frame_size(index)
            rows, columns = slice(*rows.indices(height)), slice(*columns.indices(width))
        found: NDArray[np.uint16] = self._read(f"{layout.DATA}/images", (index, rows, columns))
        return found

    def frame_size(self, index: int) -> tuple[int, int]:
        """Return rows and columns of a frame."""
        return self.readout_of(index).shape(self.whole_frame)

    def readout_of(self, index: int) -> Readout:
        """Return how the sensor was read for a frame."""
        if self._reads_plainly:
            return self.readouts[0]
        return self.readouts[int(self._read(f"{layout.DATA}/readout", index))]

    @cached_property
    def readouts(self) -> list[Readout]:
        """How the sensor was read: what the column `readout` has indices into."""
        if not self._has(layout.READOUTS):
            return [AS_OPENED]
        with self._damage_as_user_error(layout.READOUTS):
            return [Readout.of_data(one) for one in self._json("readouts")]

    @property
    def chosen_readout(self) -> int:
        """The number of the chosen readout, or else of the only one.

        Raises UserError if there are several, or none of the chosen number.
        """
        number, count = self._chosen, len(self.readouts)
        if count <= 1 if number is None else 0 <= number < count:
            return number or 0
        told = (
            f"{n}: {one.describe() or 'whole frames'}" for n, one in enumerate(self.readouts[:12])
        )
        listed = f"its frames are read as {'; '.join(told)}"
        if number is not None:
            raise UserError(f"--readout: {self.path} has no number {number}; {listed}.")
        raise UserError(f"{self.path}: choose one by --readout NUMBER; {listed}.")

    @property
    def camera(self) -> Camera:
        """The description of the camera, with its sensor as the chosen readout reads it."""
        return self.readouts[self.chosen_readout].read_camera(self.bench.build_camera())

    @cached_property
    def _reads_plainly(self) -> bool:
        """Whether all frames are whole ones, none of which is a mean."""
        return all(one == AS_OPENED for one in self.readouts)

    @cached_property
    def whole_frame(self) -> tuple[int, int]:
        """Rows and columns of the frames as the bench opened the camera."""
        known = self.capabilities
        return known.frame_shape if known else self.frame_shape

    @cached_property
    def frame_shape(self) -> tuple[int, int]:
        """Rows and columns of the largest frame."""
        with self._damage_as_user_error(f"{layout.DATA}/images"):
            _, rows, columns = self._file[f"{layout.DATA}/images"].shape
            return int(rows), int(columns)

    def select(self, **criteria: Any) -> list[int]:
        """Return the indices of stored frames that have given column values.

        target and pattern are given by name, others by value, for example exposure_asked. The
        frames are those of one readout.
        """
        names = {"target": self.target_names, "pattern": self.pattern_names}
        keep = self.column("stored").astype(bool)
        keep &= self.column("readout") == self.chosen_readout
        for column, value in criteria.items():
            known = names.get(column)
            if known is not None:
                if value not in known:
                    return []
                value = known.index(value)
            keep &= self.column(column) == value
        return np.flatnonzero(keep).tolist()

    def seeded_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that plan, seed and bench determine, by path.

        Arrays that differ between runs of the same plan are left out: wall-clock times, log,
        the camera's frame numbers, and numbers of attempts.
        """
        found: dict[str, NDArray[Any]] = {}

        def collect(path: str, item: Any) -> None:
            group, _, name = path.rpartition("/")
            decided = group not in (layout.ENTRY, layout.DIGESTS) and name not in layout.UNSEEDED
            if isinstance(item, h5py.Dataset) and item.shape and decided:
                found[path] = item[()]

        self._file.visititems(collect)
        return found

    def _validated(self, name: str, model: type[M]) -> M:
        """Return a file that is kept as text, validated once as long as it's the same text.

        What a sensor's spectra are checked for takes longer than a frame is read.
        """
        known = name, self.text(name)
        if known not in self._known:
            self._known[known] = validate(self._json(name), model, f"{self.path}: {name}")
        file: M = self._known[known]
        return file


def file_sha256(file: Path) -> str:
    """Return a file's SHA-256 in hexadecimal; empty if it can't be read."""
    try:
        with open_regular(file) as opened:
            return file_digest(opened, "sha256").hexdigest()
    except UserError:
        return ""
