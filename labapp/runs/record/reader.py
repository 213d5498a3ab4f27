"""Read a record, also while it is being written, and after its writer was killed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from hashlib import file_digest, sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import checksum
from labapp.common.errors import UserError
from labapp.files.file_lookup import require_file
from labapp.files.guarded_reading import open_regular, unreadable
from labapp.files.plain_hdf5 import explain_system_error, open_hdf5
from labapp.files.plan_file import PlanFile
from labapp.files.reading import M, validate
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.readouts import AS_OPENED, Readout
from labapp.runs.record import digests, layout, writer_process
from labapp.runs.record.chain import AT_ONCE, FrameChain, LogChain, follow_frames, follow_log
from labapp.runs.record.place_table import TableError, find_places
from labapp.runs.record.second_copy import read_either_table
from labapp.runs.record.structure import read_structure, require_plain_structure
from labapp.runs.record.verification import advise_salvage
from labapp.runs.state import State
from optics.progress import Progress

if TYPE_CHECKING:
    # These are imported when they are needed, because they load all devices, lenses and scenes.
    from labapp.files.bench_file import BenchFile
    from labapp.files.scene_file import SceneFile
    from optics.camera import Camera

_SIGNATURE = b"\x89HDF\r\n\x1a\n"

_LINKS_AT_ONCE, _LINK_BLOCKS = 1 << 10, 16
"""Links of frames that are read at once, and how often that many are kept: 1.6 MB, for records of
up to 16 sittings. Chosen."""

_DAMAGE_ERRORS = (
    KeyError,
    OSError,
    RuntimeError,
    ValueError,
    TypeError,
    AttributeError,
    MemoryError,
)
"""Exceptions of h5py, and of decoding, when a file is damaged."""


class Record:
    """A record of a run, opened for reading; a context manager.

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
        self.path = path
        require_file(path)
        try:
            self.structure = read_structure(path)
        except OSError as error:
            raise unreadable(path, error) from error
        if self.structure is not None and path.stat().st_size < self.structure.table.size:
            there, full = path.stat().st_size, self.structure.table.size
            raise UserError(f"{path}: {_cut_short(path, there, full)}")
        if self.structure is not None and self.structure.changed and not damaged:
            raise UserError(f"{path}: is damaged: {self.structure.explain(path)}")
        try:
            self._file = open_hdf5(path)
        except (OSError, RuntimeError) as error:
            raise UserError(f"{path}: {_explain_open_failure(path, error)}") from error
        self._found: dict[str, h5py.Dataset] = {}
        self._known: dict[tuple[str, str], Any] = {}
        self._chosen = readout
        self._links: dict[int, NDArray[Any]] = {}
        try:
            self._require_known_format()
            require_plain_structure(self._file, path)
        except UserError:
            self.close()
            raise

    def _require_known_format(self) -> None:
        """Raise UserError if the file isn't a record that this program reads."""
        with self._damage_as_user_error("labapp_format"):
            self.format = self._file.attrs.get("labapp_format")
        if self.format not in (*layout.PROTECTED_FORMATS, layout.UNPROTECTED_FORMAT):
            raise UserError(
                f"{self.path}: is not a record of format {layout.FORMAT} (found {self.format}). "
                "Give a record that `labapp run` or `labapp demo` wrote."
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._found.clear()
        self._file.close()

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

    def text(self, name: str) -> str:
        """Return a text of the entry, such as title or start_time, by name."""
        with self._damage_as_user_error(f"entry/{name}"):
            return self._read(f"entry/{name}").decode()

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
        """Return the names of the patterns that have changed since they were shown.

        They are compared by SHA-256.
        """
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
        """Return a pattern's grey levels, (rows, columns).

        The grey levels of a video are (frames, rows, columns).
        """
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

    def column(self, name: str) -> NDArray[Any]:
        """Return a column, one value per planned frame.

        labapp.runs.record.layout lists the columns.
        """
        if name == "readout" and not self._has(layout.READOUTS):
            return np.zeros(self.frame_count, layout.PLANNED[name])
        return self._read(f"{layout.DATA}/{name}")

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
        found: NDArray[np.uint16] = self._read(
            f"{layout.DATA}/images", (index, *self._part(index, rows, columns))
        )
        return found

    def _part(self, index: int, rows: slice, columns: slice) -> tuple[slice, slice]:
        """Return where a part of a frame lies in the row that holds it."""
        if self._reads_plainly:
            return rows, columns
        height, width = self.frame_size(index)
        return slice(*rows.indices(height)), slice(*columns.indices(width))

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

    def _listed(self) -> str:
        """List the readouts in words, for errors."""
        told = [
            f"{n}: {one.describe() or 'whole frames'}" for n, one in enumerate(self.readouts[:12])
        ]
        return f"its frames are read as {'; '.join(told)}"

    @property
    def chosen_readout(self) -> int:
        """The number of the chosen readout, or else of the only one.

        Raises UserError if there are several, or none of the chosen number.
        """
        number, count = self._chosen, len(self.readouts)
        if number is not None and not 0 <= number < count:
            raise UserError(f"--readout: {self.path} has no number {number}; {self._listed()}.")
        if number is None and count > 1:
            raise UserError(f"{self.path}: choose one by --readout NUMBER; {self._listed()}.")
        return number or 0

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

    @property
    def frame_count(self) -> int:
        with self._damage_as_user_error(f"{layout.DATA}/images"):
            return int(self._file[f"{layout.DATA}/images"].shape[0])

    @property
    def log(self) -> list[tuple[float, str]]:
        return list(self.log_lines())

    def log_lines(self) -> Iterator[tuple[float, str]]:
        """Yield bench time in seconds and text of the lines in the log, one by one."""
        for rows in self._blocks("entry/log"):
            with self._damage_as_user_error("entry/log"):
                lines = [(float(r["time"]), r["text"]) for r in rows[rows["text"] != b""]]
            yield from ((time, text.decode(errors="replace")) for time, text in lines)

    def frames_not_stored(self) -> list[int]:
        """Return the indices of planned frames that were never stored."""
        return np.flatnonzero(self.column("stored") == 0).tolist()

    def missing_frames(self) -> list[int]:
        """Return the indices of frames that were never stored, or are damaged since."""
        stored = np.flatnonzero(self.column("stored"))
        return sorted(self.frames_not_stored() + self.damaged_frames(stored, Progress()))

    def read_back(
        self, indices: Sequence[int], progress: Progress
    ) -> tuple[list[int], list[int], list[int]]:
        """Read frames back; return the indices of intact, never stored and damaged ones."""
        wanted, stored = np.array(indices, np.intp), self.column("stored") != 0
        damaged = self.damaged_frames(wanted[stored[wanted]], progress)
        whole = stored.copy()
        whole[damaged] = False
        return wanted[whole[wanted]].tolist(), wanted[~stored[wanted]].tolist(), damaged

    def damaged_frames(self, indices: NDArray[np.intp], progress: Progress) -> list[int]:
        """Return those of some stored frames that don't read back."""
        is_whole, count = self._frame_check(), len(indices)

        def is_damaged(done: int, index: int) -> bool:
            progress.report(done / count, f"read frame {index} back")
            return not is_whole(index)

        # One by one: a list of all of them would take most of the memory of the check.
        return [index for done, index in enumerate(map(int, indices)) if is_damaged(done, index)]

    def _frame_check(self) -> Callable[[int], bool]:
        """Return the function that tells whether a stored frame is whole.

        By its link, which covers image and settings; in older formats by its checksum.
        """
        if not self.is_protected:
            sums = self.column("checksum")
            return lambda index: self._image_has(
                index, lambda image: checksum(image) == sums[index]
            )
        latest, rows = self.frame_chain.latest, self._link
        columns = {name: self.column(name) for name in digests.SETTINGS}

        def is_whole(index: int) -> bool:
            if latest[index] < 0:
                return False
            row = rows(int(latest[index]))
            settings = {name: column[index] for name, column in columns.items()}
            return bool(
                digests.settings_digest(settings) == row["settings"].tobytes()
            ) and self._image_has(
                index, lambda image: digests.image_digest(image) == row["image"].tobytes()
            )

        return is_whole

    def _link(self, number: int) -> np.void:
        """Return a row of the frames' chain; rows nearby are read along with it."""
        first = number - number % _LINKS_AT_ONCE
        if first not in self._links:
            if len(self._links) == _LINK_BLOCKS:
                del self._links[next(iter(self._links))]
            name = f"{layout.DIGESTS}/chain"
            self._links[first] = self._read(name, slice(first, first + _LINKS_AT_ONCE))
        found: np.void = self._links[first][number - first]
        return found

    def _image_has(self, index: int, test: Callable[[NDArray[np.uint16]], bool]) -> bool:
        """Return whether a frame's image can be read and passes a test."""
        try:
            return test(self._read(f"{layout.DATA}/images", index))
        except UserError:
            return False

    @property
    def is_protected(self) -> bool:
        """Whether there are digests; older formats have none."""
        return bool(self.format != layout.UNPROTECTED_FORMAT)

    @cached_property
    def frame_chain(self) -> FrameChain:
        """The links of the frames, as they were when they were first asked for."""
        name = f"{layout.DIGESTS}/chain"
        with self._damage_as_user_error(name):
            return follow_frames(self._blocks(name), self._structure_digest, self.frame_count)

    @property
    def log_chain(self) -> LogChain:
        with self._damage_as_user_error("entry/log"):
            return follow_log(self._blocks("entry/log"), self._structure_digest)

    @property
    def lost_log_lines(self) -> int:
        """Lines for which the log had no room."""
        return int(self._read("entry/log_lost")[0]) if self.is_protected else 0

    @property
    def _structure_digest(self) -> bytes:
        return bytes(self._read(f"{layout.DIGESTS}/structure")[0])

    def compute_closing_digest(self, state: State | None = None) -> str:
        """Compute the digest over all, in hexadecimal: as it is, or with another state."""
        frames, lines = self.frame_chain, self.log_chain
        ending = {name: self._read(f"entry/{name}").tobytes() for name in digests.ENDING}
        if state is not None:
            ending["state"] = np.array(state.value.encode(), layout.STATE).tobytes()
        return digests.closing_digest(
            self._structure_digest, frames.length, frames.last, lines.length, lines.last,
            ending.values(),
        ).hex()  # fmt: skip

    def moved_datasets(self) -> list[str]:
        """Return the datasets that lie elsewhere than the table of places tells."""
        if self.structure is None:
            return []
        known = self.structure.table
        there = find_places(self._file, known.size)
        names = sorted({*known.places, *there.places})
        return [
            name
            for name in names
            if name not in known.places
            or replace(known.places[name], digest="") != there.places.get(name)
        ]

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

    def _has(self, name: str) -> bool:
        """Return whether there is a dataset, which older records may lack."""
        with self._damage_as_user_error(name):
            return name in self._file

    def _read(self, name: str, rows: Any = ()) -> Any:
        """Read a dataset by its path, or some of its rows."""
        with self._damage_as_user_error(name):
            # Finding a dataset takes HDF5 longer than reading a small frame.
            if name not in self._found:
                self._found[name] = self._file[name]
            return self._found[name][rows]

    def _blocks(self, name: str) -> Iterator[NDArray[Any]]:
        """Yield the rows of a dataset, some thousands at once."""
        with self._damage_as_user_error(name):
            count = len(self._file[name])
        for first in range(0, count, AT_ONCE):
            yield self._read(name, slice(first, first + AT_ONCE))

    def _single_text(self, name: str) -> str:
        """Read a text that is a dataset with a single row in the entry."""
        with self._damage_as_user_error(f"entry/{name}"):
            return self._read(f"entry/{name}")[0].decode()

    def _texts(self, name: str) -> list[str]:
        with self._damage_as_user_error(name):
            return [text.decode() for text in self._read(name)]

    def _json(self, name: str) -> Any:
        with self._damage_as_user_error(f"entry/{name}"):
            return json.loads(self.text(name))

    def _validated(self, name: str, model: type[M]) -> M:
        """Return a file that is kept as text, validated once as long as it's the same text.

        What a sensor's spectra are checked for takes longer than a frame is read.
        """
        known = name, self.text(name)
        if known not in self._known:
            self._known[known] = validate(self._json(name), model, f"{self.path}: {name}")
        file: M = self._known[known]
        return file

    @contextmanager
    def _damage_as_user_error(self, name: str) -> Iterator[None]:
        """Raise UserError that names a damaged part if the block can't read it."""
        try:
            yield
        except _DAMAGE_ERRORS as error:
            if (told := explain_system_error(error)) is not None:
                raise UserError(f"{self.path}: {name} {told}") from error
            raise UserError(
                f"{self.path}: is damaged: {name} is missing or can't be read. "
                f"{advise_salvage(self.path)}"
            ) from error


def _explain_open_failure(path: Path, error: Exception) -> str:
    """Return why HDF5 doesn't open a file, and what the user should do."""
    if (told := explain_system_error(error)) is not None:
        return told
    if not _is_record(path):
        return "is not an HDF5 file, or has lost its beginning. Give a record of a run."
    if (full := stored_file_size(error)) is not None:
        return _cut_short(path, path.stat().st_size, full)
    return f"is damaged: HDF5 can't open it ({error}). {advise_salvage(path)}"


def _is_record(path: Path) -> bool:
    """Return whether a file that HDF5 can't open may be a record all the same."""
    with path.open("rb") as file:
        try:
            read_either_table(file.fileno())
        except TableError:
            return file.read(len(_SIGNATURE)) == _SIGNATURE
        return True


def stored_file_size(error: Exception) -> int | None:
    """Return the size that a truncated file had by HDF5's error; None for other errors."""
    found = re.search(r"truncated file: eof = \d+,.*stored_eof = (\d+)", str(error))
    return int(found[1]) if found else None


def _cut_short(path: Path, there: int, full: int) -> str:
    return f"is cut short: {there} of {full} bytes are there. {advise_salvage(path)}"


def file_sha256(file: Path) -> str:
    """Return a file's SHA-256 in hexadecimal; empty if it can't be read."""
    try:
        with open_regular(file) as opened:
            return file_digest(opened, "sha256").hexdigest()
    except UserError:
        return ""
