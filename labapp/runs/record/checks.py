"""The checks of a record, which also work on a badly damaged one.

HDF5 doesn't validate a file's structure: a few damaged bytes can make it search for ever, or end
the process. Therefore `send_verification` makes the checks in a process of its own. The parent
process ends it when it has reported no progress for long.
"""

from __future__ import annotations

import json
import re
import socket
from bisect import bisect_left
from collections.abc import Callable, Iterable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.hosted.calls import CallResult
from drivers.hosted.message_socket import MessageSocket
from labapp.common.errors import UserError
from labapp.files.frame_list import format_frame_list
from labapp.files.plan_file import ROLES
from labapp.runs.frame_acceptance import EXPOSURE_TOLERANCE, WAVELENGTH_TOLERANCE
from labapp.runs.record import layout
from labapp.runs.record.digest_checks import check_closing, check_copy, check_links, check_log
from labapp.runs.record.reader import Record, file_sha256
from labapp.runs.record.verification import (
    RecordFinding,
    StatusAndDetail,
    Verification,
)
from labapp.runs.state import State
from labapp.runs.steps import planned_shots
from optics.progress import Cancelled, Progress

_SETTING_TOLERANCES = (
    ("exposure", *EXPOSURE_TOLERANCE, 1e3, "ms"),
    ("wavelength", WAVELENGTH_TOLERANCE, 0.0, 1e9, "nm"),
)
"""Each setting with the allowed difference from its request, absolute and as a share, and with
the scale and name of the unit in messages."""


def check_record(path: Path, progress: Progress | None = None, *, digest: str = "") -> Verification:
    """Make all checks that a file's damage allows, in this process.

    digest: the one that the end of the run printed, to be compared; or "".
    """
    found = Verification(str(path))
    try:
        record = Record(path, damaged=True)
    except UserError as error:
        found.findings.append(RecordFinding("file", "WRONG", _detail(path, error)))
        return found
    with record:
        found.findings.append(RecordFinding("file", "ok", f"a record of format {record.format}"))
        checks = _Checks(record, found, progress or Progress(), digest)
        share = 0.0
        for name, check in checks.by_name().items():
            checks.progress.report(share, f"check {name}")
            try:
                result, detail = check()
                finding = RecordFinding(name, result, _printable(detail))
            except Cancelled:
                raise
            except UserError as error:
                finding = RecordFinding(name, "WRONG", _detail(path, error))
            except Exception as error:
                # Damaged data may raise any exception, and the other checks must still be made.
                text = f"can't be checked: {type(error).__name__}: {error}"
                finding = RecordFinding(name, "WRONG", _printable(text))
            found.findings.append(finding)
            # The progress is that of reading the frames back, which is nearly all of the work.
            share = 1.0 if name == "checksums" else share
    return found


class _Checks:
    """The checks, in the order in which they are listed."""

    def __init__(
        self, record: Record, found: Verification, progress: Progress, digest: str
    ) -> None:
        self._record, self._found, self.progress = record, found, progress
        self._digest = digest

    def by_name(self) -> dict[str, Callable[[], StatusAndDetail]]:
        """Return the checks by name; later ones use the findings of earlier ones."""
        return {
            "structure": self._check_structure,
            "contents": self._check_contents,
            "plan": self._check_planned_columns,
            "frames": self._check_frames,
            "checksums": self._check_checksums,
            "digests": lambda: check_links(self._record),
            "log": lambda: check_log(self._record),
            "patterns": self._check_patterns,
            "settings": self._check_settings,
            "camera": self._check_camera,
            "state": self._check_state,
            "closing": lambda: check_closing(self._record, self._digest),
            "copy": lambda: check_copy(self._record),
            "scene pictures": self._check_scene_pictures,
        }

    def _check_structure(self) -> StatusAndDetail:
        """Check that all that was known before the first frame is as it was."""
        structure = self._record.structure
        if structure is None and self._record.format == layout.UNPROTECTED_FORMAT:
            return "note", "of an older format: settings, log and texts aren't protected"
        if structure is None:
            return "WRONG", "the table of places at the file's beginning is missing or damaged"
        if structure.changed:
            return "WRONG", structure.explain(self._record.path)
        if moved := self._record.moved_datasets():
            return "WRONG", f"not at the place that the table tells: {', '.join(moved)}"
        return "ok", "all that was known before the first frame is as it was"

    def _check_contents(self) -> StatusAndDetail:
        """Check that all datasets decode, and have the right type and length."""
        record = self._record
        for name in ("title", "definition", "start_time"):
            record.text(name)
        _ = record.plan, record.bench, record.scene, record.effect_plan, record.faults
        _ = record.devices, record.message, record.seed, record.expected_seconds, record.readouts
        for _ in record.log_lines():
            pass
        wrong = [
            name
            for name, dtype in (layout.PLANNED | layout.MEASURED).items()
            if (column := record.column(name)).dtype != dtype
            or column.shape != (record.frame_count,)
        ]
        if wrong:
            return "WRONG", f"of the wrong type or length: {', '.join(wrong)}"
        rows, columns = record.frame_shape
        if not _is_axis(record.column("y"), rows) or not _is_axis(record.column("x"), columns):
            return "WRONG", "the places of the pixels, y and x, aren't even"
        by = f"labapp {record.versions['labapp']}"
        return "ok", f"{record.frame_count} frames of {columns} x {rows} pixels, by {by}"

    def _check_planned_columns(self) -> StatusAndDetail:
        """Check that planned indices exist, settings are positive, and all is by the plan."""
        record = self._record
        known = {
            "role": len(ROLES),
            "target": len(record.target_names),
            "pattern": len(record.pattern_names),
            "readout": len(record.readouts),
        }
        for column, count in known.items():
            if bad := _where(record.column(column) >= count):
                return "WRONG", f"no such {column}: of frames {format_frame_list(bad)}"
        if not np.array_equal(record.column("frame"), np.arange(record.frame_count)):
            return "WRONG", "the frames aren't numbered one after the other"
        for column in ("exposure_asked", "wavelength_asked"):
            if bad := _where(~_is_positive(record.column(column))):
                return "WRONG", f"no {column}: of frames {format_frame_list(bad)}"
        if (capabilities := record.capabilities) is not None:
            shots = planned_shots(record.plan, capabilities)
            planned = layout.planned_columns(shots, record.target_names, record.pattern_names)
            wrong = [
                name
                for name, values in planned.items()
                if not np.array_equal(values, record.column(name))
            ]
            if wrong:
                return "WRONG", f"not what the plan asks for: {', '.join(wrong)}"
        return "ok", f"{known['target']} targets, {known['pattern']} patterns"

    def _check_frames(self) -> StatusAndDetail:
        """Check that every planned frame is stored."""
        record = self._record
        self._found.not_stored = missing = record.frames_not_stored()
        if not missing:
            return "ok", f"all {record.frame_count} are stored"
        frames = format_frame_list(missing)
        detail = f"{len(missing)} of {record.frame_count} were never stored: {frames}"
        return "WRONG" if record.state is State.COMPLETE else "unfinished", detail

    def _check_checksums(self) -> StatusAndDetail:
        """Check that every stored frame still reads back as it was stored."""
        stored = self._stored_indices()
        self._found.damaged = self._record.damaged_frames(stored, self.progress)
        if damaged := self._found.damaged:
            return "WRONG", f"{len(damaged)} frames don't read back: {format_frame_list(damaged)}"
        return "ok", f"{len(stored)} stored frames read back as they were"

    def _check_patterns(self) -> StatusAndDetail:
        """Check by their SHA-256 that the patterns are as they were shown."""
        record = self._record
        if changed := record.changed_patterns():
            return "WRONG", f"not as they were shown: {', '.join(changed)}"
        return "ok", f"{len(record.pattern_names)} patterns are as they were shown"

    def _check_settings(self) -> StatusAndDetail:
        """Check that the frames were taken with the settings that the plan asks for."""
        record, stored = self._record, self._stored_indices()
        for name, step, share, scale, unit in _SETTING_TOLERANCES:
            used, asked = record.column(name)[stored], record.column(f"{name}_asked")[stored]
            # The negation makes NaN wrong, too.
            if bad := _where(~(np.abs(used - asked) <= np.maximum(step, share * asked))):
                first = f"{used[bad[0]] * scale:g} instead of {asked[bad[0]] * scale:g} {unit}"
                return (
                    "WRONG",
                    f"{name} of frames {format_frame_list(stored[i] for i in bad)}: {first}",
                )
        if bad := _where(~_is_positive(record.column("gain")[stored])):
            return "WRONG", f"no gain: of frames {format_frame_list(stored[i] for i in bad)}"
        return "ok", "exposures and wavelengths are those asked for"

    def _check_camera(self) -> StatusAndDetail:
        """Check that times, attempts and the camera's frame numbers are possible."""
        record, stored = self._record, self._stored_indices()
        for name in ("time", "timestamp", "attempts"):
            values = record.column(name)[stored]
            # The bench's clock begins at 0, so only this time may be 0.
            is_good = _is_positive(values) | ((values == 0) & (name == "time"))
            if bad := _where(~is_good):
                return "WRONG", f"no {name}: of frames {format_frame_list(stored[i] for i in bad)}"
        return self._check_order(stored)

    def _check_order(self, stored: NDArray[np.intp]) -> StatusAndDetail:
        """Check that times and frame numbers restart only as the log explains.

        The run and each of its resumptions take frames in the order of the plan, with a rising
        clock and a camera that counts from its start. So in the order of the plan, times and
        numbers must be a mixture of at most that many rising sequences. A failed attempt may also
        have opened the camera again, which restarts its numbers.
        """
        record = self._record
        lines = resumed = failed = 0
        for _, text in record.log_lines():
            lines += 1
            resumed += text.startswith("resumed:")
            failed += bool(re.match(r"frame \d+, attempt \d+ of ", text))
        # A power cut takes lines of the log rather than frames that are older than a second or two.
        failed = max(failed, int(record.column("attempts")[stored].sum()) - len(stored))
        times, numbers = record.column("time")[stored], record.column("number")[stored]
        said = f"{resumed} resumptions, {failed} failed attempts"
        if lines >= layout.log_capacity(record.frame_count):
            return "ok", f"not compared with the log, which is full ({said})"
        if _min_rising_sequences(times.data) > 1 + resumed:
            return "WRONG", f"the bench's time runs backwards more often than the log tells: {said}"
        if _min_rising_sequences(numbers.data) > 1 + resumed + failed:
            return "WRONG", f"the camera counts backwards more often than the log tells: {said}"
        ends = times + record.column("exposure")[stored]
        # Consecutive exposures may seem to overlap by up to 1 µs.
        if not resumed and np.any(times[1:] < ends[:-1] - 1e-6):
            return "WRONG", "exposures begin before the last one has ended"
        return "ok", f"times and the camera's count rise ({said})"

    def _check_state(self) -> StatusAndDetail:
        """Check that the state agrees with the frames."""
        record, found = self._record, self._found
        found.state = state = record.state
        if state is State.COMPLETE and found.not_stored:
            return "WRONG", f"COMPLETE, and yet {len(found.not_stored)} frames are missing"
        if state.has_ended:
            ended = datetime.fromisoformat(record.end_time)
            detail = f"{state}, ended {ended:%Y-%m-%d %H:%M}"
            if state is State.COMPLETE:
                return "ok", detail
            return "unfinished", f"{detail}: {record.message}"
        writer = json.loads(record.writer)
        who = f"process {writer['pid']} on {writer['host']}"
        if state is State.INTERRUPTED:
            return "unfinished", f"INTERRUPTED: {who} wrote it, and is gone without a word"
        found.is_being_written = True
        if writer["host"] != socket.gethostname():
            return "unfinished", f"{state}: {who} writes it, or died; only there that shows"
        return "unfinished", f"{state}: {who} writes it"

    def _check_scene_pictures(self) -> StatusAndDetail:
        """Check that the picture files of the scene exist and are unchanged."""
        known = self._record.scene_picture_digests
        if not known:
            return "ok", "the scene has none"
        now = {file: file_sha256(Path(file)) for file in known}
        gone = [file for file, found in now.items() if not found]
        changed = [file for file, found in now.items() if found and found != known[file]]
        if not gone and not changed:
            return "ok", f"{len(known)} are as they were"
        told = [f"gone: {', '.join(gone)}"] * bool(gone)
        told += [f"changed: {', '.join(changed)}"] * bool(changed)
        if self._found.state is State.COMPLETE:
            # A complete record doesn't need the picture files.
            return "note", f"{'; '.join(told)}; the run can't be repeated exactly"
        return "unfinished", f"{'; '.join(told)}; put them back before you resume"

    def _stored_indices(self) -> NDArray[np.intp]:
        return np.flatnonzero(self._record.column("stored"))


def _where(condition: NDArray[np.bool_]) -> list[int]:
    found: list[int] = np.flatnonzero(condition).tolist()
    return found


def _is_positive(values: NDArray[Any]) -> NDArray[np.bool_]:
    return np.isfinite(values) & (values > 0)


def _is_axis(places: NDArray[Any], size: int) -> bool:
    """Return whether pixel positions are evenly spaced, with 0 at n // 2."""
    steps = np.diff(places)
    if places.shape != (size,) or places[size // 2] != 0:
        return False
    return steps.size == 0 or bool(steps[0] > 0 and np.allclose(steps, steps[0], 1e-6, 0))


def _min_rising_sequences(values: Iterable[float]) -> int:
    """Return the least number of strictly rising sequences that make up the values."""
    ends: list[float] = []
    for value in values:
        # The value joins the sequence with the highest end below it, which is the best choice.
        place = bisect_left(ends, value) - 1
        if place < 0:
            ends.insert(0, value)
        else:
            ends[place] = value
    return len(ends)


def _detail(path: Path, error: UserError) -> str:
    return _printable(str(error).removeprefix(f"{path}: "))


def _printable(text: str) -> str:
    """Replace control characters, which a damaged record could send to the terminal, by blanks."""
    return "".join(one if one.isprintable() else " " for one in text)


def send_verification(line: MessageSocket, asked: tuple[Path, str]) -> None:
    """Check a file; send the progress as (share, message), and at last the findings.

    asked: the file, and the digest that it should have, or an empty text.
    """
    path, digest = asked
    progress = Progress(lambda share, message: line.send((share, message)))
    progress.report(0.0, "open the record")
    line.send(CallResult(check_record(path, progress, digest=digest)))
