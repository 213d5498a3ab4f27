"""`labapp export`: frames of a record as files that other programs read."""

from __future__ import annotations

import csv
import json
import math
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import labapp
from labapp.console import out, watched
from labapp.errors import UserError
from labapp.files.frame_list import frame_list, read_frame_list
from labapp.files.ome import Plane, Series, ome_xml
from labapp.files.writing import require_writable
from labapp.record import layout
from labapp.record.reader import Record
from optics.progress import Progress

KINDS = ("tiff", "png", "ome-tiff", "npy")

_SINGLE = ("tiff", "png")
"""Kinds of which every frame is a file."""

_TABLE = "frames.csv"

_CHECKING = 0.3
"""Share of the progress that goes into reading every frame back before the first is written."""

_TIFF_LIMIT = 2**32 - 2**25
"""Bytes that a TIFF file can have, with room for its tables of contents; more is BigTIFF."""

_NAME_BYTES = 60
"""Of a target's or pattern's name in a file's name: file systems take 255 for the whole."""

Rows = list[dict[str, Any]]
"""The columns of the record for each frame, with names instead of numbers of names."""


@dataclass(frozen=True)
class Choice:
    """Which frames: a list such as "0-9,12", a target, a pattern; None: all of them."""

    frames: str | None = None
    target: str | None = None
    pattern: str | None = None


@dataclass(frozen=True)
class Exported:
    """What was written: files in `folder`, frames by index, and which had to be left out."""

    folder: Path
    files: list[str]
    frames: list[int]
    not_stored: list[int]
    damaged: list[int]
    bits: int | None

    def require_all(self, record: Path) -> None:
        """UserError that names the frames that were asked for and aren't there."""
        told = []
        if self.not_stored:
            told.append(f"never stored: {frame_list(self.not_stored)}")
        if self.damaged:
            told.append(f"stored, but damaged since: {frame_list(self.damaged)}")
        if told:
            raise UserError(
                f"{record}: {len(self.not_stored) + len(self.damaged)} frames are missing and "
                f"were left out ({'; '.join(told)}). To take them: labapp resume {record}"
            )


def export_record(path: Path, kind: str, folder: Path, choice: Choice, *, force: bool) -> None:
    """Export frames, say what was written, and raise UserError if frames are missing."""
    with watched() as progress:
        done = export(path, kind, folder, choice, force=force, progress=progress)
    if done.frames:
        out.print(f"wrote {len(done.frames)} frames to {folder}, and {_TABLE}", markup=False)
    if done.frames and done.bits is not None and done.bits < 16 and kind != "npy":
        out.print(f"raw numbers of {done.bits} bits, not scaled: viewers may show them dark")
    done.require_all(path)


def export(
    path: Path,
    kind: str,
    folder: Path,
    choice: Choice = Choice(),
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> Exported:
    """Write frames of a record into a folder, which is made if need be.

    kind: of KINDS. tiff, png: a 16-bit picture a frame; ome-tiff: one frames.ome.tiff, axes
    TYX; npy: frames.npy (n, rows, columns) uint16, and frames.json. Digital numbers are
    never changed. With every kind comes a table of the frames. Frames that aren't stored or
    don't read back are left out. Files appear all together when the last one is whole:
    whoever cancels finds none. UserError if nothing can be chosen, read or written.
    """
    progress = progress or Progress()
    if kind not in KINDS:
        raise UserError(f"--to: {kind!r} is none of {', '.join(KINDS)}.")
    with Record(path) as record:
        chosen = _choose(record, choice)
        _require_free(folder, _file_names(kind, record, chosen), force)
        found, not_stored, damaged = _sound(record, chosen, progress.part(0, _CHECKING))
        work = _Work(record, kind, found, progress.part(_CHECKING, 1))
        files = _write(work, folder) if found else []
        return Exported(folder, files, found, not_stored, damaged, work.bits)


class _Work:
    """What all kinds of export need: frames one after the other, and what is known of them."""

    def __init__(self, record: Record, kind: str, frames: list[int], progress: Progress) -> None:
        self.record, self.kind, self.frames, self._progress = record, kind, frames, progress
        self.names = _file_names(kind, record, frames)
        self.rows = _rows(record, frames)
        self.shape = len(record.column("y")), len(record.column("x"))
        self.pitch = _pitch(record)
        self.bits = _bits(record)

    def images(self) -> Iterator[NDArray[np.uint16]]:
        """Frame by frame, (rows, columns), with progress; raises Cancelled."""
        for done, index in enumerate(self.frames):
            self._progress.report(done / len(self.frames), f"export frame {index}")
            yield self.record.image(index)


def _choose(record: Record, choice: Choice) -> list[int]:
    """Indices of the frames that are asked for, stored or not; UserError if there are none."""
    total = record.frames
    chosen = read_frame_list(choice.frames, total) if choice.frames is not None else range(total)
    keep = np.zeros(total, bool)
    keep[list(chosen)] = True
    known = {"target": record.target_names, "pattern": record.pattern_names}
    for column, names in known.items():
        name = getattr(choice, column)
        if name is None:
            continue
        if name not in names:
            raise UserError(f"--{column}: {name!r} is none of the record's: {', '.join(names)}.")
        keep &= record.column(column) == names.index(name)
    if not keep.any():
        raise UserError(f"{record.path}: no frame is all that was asked for. Ask for less.")
    return np.flatnonzero(keep).tolist()


def _sound(
    record: Record, chosen: Sequence[int], progress: Progress
) -> tuple[list[int], list[int], list[int]]:
    """Frames that read back, frames that were never stored, and frames that are damaged."""
    stored, sums = record.column("stored"), record.column("checksum")
    found, not_stored, damaged = [], [], []
    for done, index in enumerate(chosen):
        progress.report(done / len(chosen), f"read frame {index} back")
        if not stored[index]:
            not_stored.append(index)
        elif not record.reads_back(index, sums[index]):
            damaged.append(index)
        else:
            found.append(index)
    return found, not_stored, damaged


def _rows(record: Record, frames: Sequence[int]) -> Rows:
    names = {
        "target": record.target_names,
        "pattern": record.pattern_names,
        "role": layout.ROLES,
    }
    columns = {}
    for name in (*layout.PLANNED, *layout.MEASURED):
        values = record.column(name)[list(frames)].tolist()
        columns[name] = (
            [_named(value, names[name]) for value in values] if name in names else values
        )
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _named(number: int, names: Sequence[str]) -> str:
    return names[number] if number < len(names) else f"unknown {number}"


def _pitch(record: Record) -> tuple[float, float] | None:
    """Of the pixels, (y, x) in metres."""
    y, x = record.column("y"), record.column("x")
    if min(len(y), len(x)) < 2:
        return None
    # As the bench has it, without the rounding of the places.
    pitch = _rounded((y[-1] - y[0]) / (len(y) - 1)), _rounded((x[-1] - x[0]) / (len(x) - 1))
    return pitch if all(0 < one < math.inf for one in pitch) else None


def _rounded(length: float) -> float:
    return float(f"{length:.12g}")


def _bits(record: Record) -> int | None:
    """Of the digital numbers; None if the bench's description can't be understood."""
    with suppress(UserError):
        return record.bench.sensor.bits
    return None


def _file_names(kind: str, record: Record, frames: Sequence[int]) -> list[str]:
    """What an export writes; of tiff and png the pictures first, one a frame."""
    if kind == "npy":
        return ["frames.npy", "frames.json", _TABLE]
    if kind == "ome-tiff":
        return ["frames.ome.tiff", _TABLE]
    # All with as many digits, so that they sort.
    digits = max(5, len(str(record.frames - 1)))
    rows = _rows(record, frames)
    named = [f"{i:0{digits}}_{_spoken(row)}" for i, row in zip(frames, rows, strict=True)]
    return [*(f"{name}.{kind}" for name in named), _TABLE]


def _spoken(row: dict[str, Any]) -> str:
    """What a frame shows, for its file's name."""
    nm, ms = row["wavelength_asked"] * 1e9, row["exposure_asked"] * 1e3
    names = f"{_plain(row['target'])}_{_plain(row['pattern'])}"
    return f"{names}_{_short(nm)}nm_{_short(ms)}ms"


def _plain(name: str) -> str:
    """A name with only letters, digits and what no file system dislikes, and not too long."""
    plain = re.sub(r"[^\w.+-]", "-", name)
    return plain.encode()[:_NAME_BYTES].decode(errors="ignore")


def _short(value: float) -> str:
    return f"{value:.3f}".rstrip("0").rstrip(".")


def _require_free(folder: Path, names: Sequence[str], force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is a file. Name a folder.")
    if folder.is_dir():
        for name in names:
            require_writable(folder / name, force=force)


def _write(work: _Work, folder: Path) -> list[str]:
    """The files of an export, all of them or none; their names."""
    try:
        with _draft_folder(folder) as draft:
            _WRITERS[work.kind](work, draft)
            _write_table(work, draft)
            for name in work.names:
                os.replace(draft / name, folder / name)
    except OSError as error:
        # numpy counts what was written, and doesn't say why it wasn't all.
        reason = error.strerror or "the disk took less than it was given; it may be full"
        raise UserError(
            f"{folder}: cannot be written: {reason}. Nothing was exported; make space there, "
            "or choose another place."
        ) from error
    return work.names


@contextmanager
def _draft_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder in the one that is written to; nothing stays in it, whatever happens."""
    is_new = not folder.exists()
    draft = folder / f".export.{os.getpid()}.new"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir()
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)
        if is_new:
            # Only if it is empty.
            with suppress(OSError):
                folder.rmdir()


def _write_tiffs(work: _Work, draft: Path) -> None:
    import tifffile

    simulated = work.record.simulated
    for name, row, image in zip(work.names, work.rows, work.images(), strict=False):
        tifffile.imwrite(
            draft / name,
            image,
            photometric="minisblack",
            description=json.dumps(row | {"units": layout.UNITS, "simulated": simulated}),
            software=f"labapp {labapp.__version__}",
            metadata=None,
            **_resolution(work),
        )


def _write_pngs(work: _Work, draft: Path) -> None:
    import cv2

    for name, image in zip(work.names, work.images(), strict=False):
        done, data = cv2.imencode(".png", image)
        if not done:
            raise UserError(f"{name}: could not be encoded.")
        (draft / name).write_bytes(data.tobytes())


def _write_ome(work: _Work, draft: Path) -> None:
    import tifffile

    shape = (len(work.frames), *work.shape)
    description = ome_xml(_series(work))
    is_big = 2 * math.prod(shape) + len(description) > _TIFF_LIMIT
    with tifffile.TiffWriter(draft / work.names[0], bigtiff=is_big, ome=False) as file:
        file.write(
            work.images(),
            shape=shape,
            dtype=np.uint16,
            photometric="minisblack",
            description=description,
            software=f"labapp {labapp.__version__}",
            metadata=None,
            **_resolution(work),
        )


def _resolution(work: _Work) -> dict[str, Any]:
    """Of a TIFF file, in pixels a centimetre; x comes first there."""
    if work.pitch is None:
        return {}
    y, x = (1e-2 / pitch for pitch in work.pitch)
    return {"resolution": (x, y), "resolutionunit": "CENTIMETER"}


def _series(work: _Work) -> Series:
    record, rows = work.record, work.rows
    camera = record.devices.get("camera", {"model": "", "serial": ""})
    simulated = ", ".join(record.simulated)
    wavelengths = {row["wavelength"] for row in rows}
    return Series(
        name=record.text("title"),
        description=f"SIMULATED: {simulated}" if simulated else "taken with real devices",
        date=record.text("start_time"),
        shape=work.shape,
        pitch=work.pitch,
        bits=work.bits,
        wavelength=wavelengths.pop() if len(wavelengths) == 1 else None,
        model=camera["model"],
        serial=camera["serial"],
        planes=[Plane(row["exposure"], row["time"], _notes(row)) for row in rows],
    )


def _notes(row: dict[str, Any]) -> dict[str, str]:
    name = f"{row['target']}, {row['pattern']}, {_short(row['wavelength'] * 1e9)} nm"
    return {"name": name} | {_heading(key): str(value) for key, value in row.items()}


def _write_npy(work: _Work, draft: Path) -> None:
    path = draft / work.names[0]
    shape = (len(work.frames), *work.shape)
    array = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint16, shape=shape)
    # A mapped file that the disk has no room for ends the process, not the call.
    with path.open("rb+") as file:
        os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
    for place, image in enumerate(work.images()):
        array[place] = image
    array.flush()
    # A line an item, so that it can be read although columns are long.
    items = [f"{json.dumps(key)}: {json.dumps(one)}" for key, one in _as_data(work).items()]
    (draft / work.names[1]).write_text("{\n" + ",\n".join(items) + "\n}\n")


def _as_data(work: _Work) -> dict[str, Any]:
    """What is known of the frames of an array, as plain data; no number: null."""
    record = work.record
    columns = {name: [_number(row[name]) for row in work.rows] for name in work.rows[0]}
    return {
        "record": str(record.path),
        "title": record.text("title"),
        "state": record.state.value,
        "simulated": record.simulated,
        "devices": record.devices,
        "seed": record.seed,
        "start_time": record.text("start_time"),
        "axes": ["frame", "y", "x"],
        "pixel_pitch_m": work.pitch,
        "bits": work.bits,
        "units": layout.UNITS,
        "targets": record.target_names,
        "patterns": record.pattern_names,
        "columns": columns,
        "plan": json.loads(record.text("plan")),
        "bench": json.loads(record.text("bench")),
    }


def _number(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _write_table(work: _Work, draft: Path) -> None:
    """A line a frame: its file, its place in it, all columns, and what was simulated."""
    simulated = " ".join(work.record.simulated)
    with (draft / _TABLE).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        headings = [_heading(name) for name in work.rows[0]]
        writer.writerow(["file", "place", *headings, "simulated"])
        for place, row in enumerate(work.rows):
            at = (work.names[place], 0) if work.kind in _SINGLE else (work.names[0], place)
            writer.writerow([*at, *row.values(), simulated])


def _heading(name: str) -> str:
    unit = layout.UNITS.get(name, "").replace("/", "_per_")
    return f"{name}_{unit}" if unit else name


_WRITERS: dict[str, Callable[[_Work, Path], None]] = {
    "tiff": _write_tiffs,
    "png": _write_pngs,
    "ome-tiff": _write_ome,
    "npy": _write_npy,
}
