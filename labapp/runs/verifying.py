"""The command `labapp verify`: check a record for damage, and suggest what to do."""

from __future__ import annotations

import sys
import tempfile
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

from drivers.hosted.calls import CallResult
from drivers.hosted.child_process import ChildProcess, ProcessEnded
from labapp.common.console import out, print_json, print_table, terminal_progress
from labapp.files.guarded_reading import require_regular
from labapp.runs.record.verification import RecordFinding, Verification, advise_salvage
from optics.progress import Progress

_STALL_TIMEOUT = 60.0
"""Seconds for which HDF5 may read one frame or the structure of a record without progress."""

_CHECKS = "labapp.runs.record.checks:send_verification"


def verify_record(path: Path, *, as_json: bool, digest: str = "") -> bool:
    """Verify a record and print the findings; return whether it is in order.

    Raises UserError if there is no such file.

    digest: the one that the end of the run printed, to be compared; or "".
    """
    with terminal_progress() as progress:
        found = verify(path, progress, digest=digest)
    if as_json:
        print_json(_as_data(found))
        return found.is_in_order
    rows = [[one.check, one.result, one.detail] for one in found.findings]
    print_table(str(path), ["check", "result", "detail"], rows)
    out.print(found.verdict, soft_wrap=True)
    return found.is_in_order


def verify(
    path: Path,
    progress: Progress | None = None,
    *,
    digest: str = "",
    timeout: float = _STALL_TIMEOUT,
) -> Verification:
    """Verify a record by all checks that its state allows, however damaged it is.

    The checks run in a process of their own, see labapp.runs.record.checks. That process is ended
    after `timeout` seconds without progress. Raises UserError if there is no such file.

    digest: the one that the end of the run printed, to be compared; or "".
    """
    progress = progress or Progress()
    require_regular(path, sys.maxsize)
    with (
        tempfile.TemporaryFile() as complaints,
        closing(
            ChildProcess(_CHECKS, (path, digest), grace=0.0, errors=complaints.fileno())
        ) as process,
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
                detail = "is damaged so badly that HDF5 doesn't come back from it. "
                wrong = RecordFinding("file", "WRONG", detail + advise_salvage(path))
                return Verification(str(path), [wrong])
            complaints.seek(0)
            said = complaints.read().decode(errors="replace")
    # Damage of the record can't cause this failure, so it is an error of the program.
    raise RuntimeError(f"the checks of {path} failed: {said[-2000:]}")


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
