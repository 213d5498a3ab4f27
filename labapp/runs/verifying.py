"""`labapp verify`: whether a record is whole, and what to do if it isn't."""

from __future__ import annotations

import tempfile
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.markup import escape

from drivers.hosted.calls import CallResult
from drivers.hosted.child_process import ChildProcess, ProcessEnded
from labapp.common.console import out, print_json, print_table, terminal_progress
from labapp.files.file_lookup import require_file
from labapp.runs.record.verification import RecordFinding, Verification
from optics.progress import Progress

_STALL_TIMEOUT = 60.0
"""Seconds for which a file may keep HDF5 busy with one frame, or with its structure."""

_CHECKS = "labapp.runs.record.checks:send_verification"


def verify_record(path: Path, *, as_json: bool) -> bool:
    """Verify a record, and print what was found; whether all is well.

    UserError if there is no such file.
    """
    with terminal_progress() as progress:
        found = verify(path, progress)
    if as_json:
        print_json(_as_data(found))
        return found.is_in_order
    rows = [[one.check, one.result, escape(one.detail)] for one in found.findings]
    print_table(str(path), ["check", "result", "detail"], rows)
    out.print(found.verdict, markup=False, soft_wrap=True)
    return found.is_in_order


def verify(
    path: Path, progress: Progress | None = None, *, timeout: float = _STALL_TIMEOUT
) -> Verification:
    """Every check that the file is still fit for, however damaged it is.

    The checks are made in a process of their own, see labapp.runs.record.checks; one that hangs
    is ended after `timeout` seconds without news. UserError if there is no such file.
    """
    progress = progress or Progress()
    require_file(path)
    with (
        tempfile.TemporaryFile() as complaints,
        closing(ChildProcess(_CHECKS, path, grace=0.0, errors=complaints.fileno())) as process,
    ):
        try:
            while not isinstance(
                news := process.receive(timeout, progress.raise_if_cancelled), CallResult
            ):
                progress.report(*news)
            if news.failure is None:
                return news.value
            said = news.failure.trace
        except ProcessEnded:
            code = process.exit_code(_STALL_TIMEOUT)
            if code is None or code < 0:
                return _unreadable_verification(path)
            complaints.seek(0)
            said = complaints.read().decode(errors="replace")
    # No damage of the file does that.
    raise RuntimeError(f"the checks of {path} failed: {said[-2000:]}")


def _unreadable_verification(path: Path) -> Verification:
    detail = "is damaged so badly that HDF5 doesn't come back from it. Restore it from a copy."
    return Verification(str(path), [RecordFinding("file", "WRONG", detail)])


def _as_data(found: Verification) -> dict[str, Any]:
    return {
        "record": found.path,
        "is_well": found.is_in_order,
        "verdict": found.verdict,
        "state": found.state,
        "checks": [asdict(one) for one in found.findings],
        "not_stored": found.not_stored,
        "damaged": found.damaged,
        "go_on": found.resume_command,
    }
