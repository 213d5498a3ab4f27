"""`labapp verify`: whether a record is whole, and what to do if it isn't."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

from rich.markup import escape

from labapp.common.console import out, print_json, table, watched
from labapp.files.finding import require_file
from labapp.runs.record.finding import Finding, Verification
from optics.progress import Progress

_PATIENCE = 60
"""Seconds for which a file may keep HDF5 busy with one frame, or with its structure."""

_LOOK = 0.1
"""Seconds between looks at whether the person wants no more."""

_Process = subprocess.Popen[bytes]


def verify_record(path: Path, *, as_json: bool) -> bool:
    """Verify a record, and print what was found; whether all is well.

    UserError if there is no such file.
    """
    with watched() as progress:
        found = verify(path, progress)
    if as_json:
        print_json(_as_data(found))
        return found.is_well
    rows = [[one.check, one.result, escape(one.detail)] for one in found.findings]
    table(str(path), ["check", "result", "detail"], rows)
    out.print(found.verdict, markup=False, soft_wrap=True)
    return found.is_well


def verify(
    path: Path, progress: Progress | None = None, *, patience: int = _PATIENCE
) -> Verification:
    """Every check that the file is still fit for, however damaged it is.

    The checks are made in a process of their own, see labapp.runs.record.checks; one that hangs
    is ended after `patience` seconds without news. UserError if there is no such file.
    """
    progress = progress or Progress()
    require_file(path)
    with tempfile.TemporaryFile() as complaints:
        with _checking(path, patience, complaints) as process:
            told = _last_line(process, progress)
            code = process.wait()
        if "found" in told:
            return _read(told["found"])
        complaints.seek(0)
        return _died(path, code, complaints.read().decode(errors="replace"))


@contextmanager
def _checking(path: Path, patience: int, complaints: IO[bytes]) -> Iterator[_Process]:
    """The process that checks a file; it ends with the block, whatever it is doing."""
    command = [sys.executable, "-m", "labapp.runs.record.checks", str(path), str(patience)]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=complaints,
        # A Ctrl-C is for this process, which ends the other.
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def _last_line(process: _Process, progress: Progress) -> dict[str, Any]:
    """What the checks found, if that is what they said last; tells the progress until then."""
    assert process.stdout is not None
    told: dict[str, Any] = {}
    for line in _lines(process.stdout, progress):
        told = json.loads(line)
        if "share" in told:
            progress.report(told["share"], told["message"])
    return told


def _lines(pipe: IO[bytes], progress: Progress) -> Iterator[bytes]:
    """Lines as they come, with an ear for who cancels; raises Cancelled."""
    rest = b""
    while True:
        progress.check()
        if not select.select([pipe], [], [], _LOOK)[0]:
            continue
        read = os.read(pipe.fileno(), 1 << 16)
        if not read:
            return
        *lines, rest = (rest + read).split(b"\n")
        yield from lines


def _died(path: Path, code: int, complaints: str) -> Verification:
    """What it means that the checks ended without an answer."""
    if code >= 0:
        # No damage of the file does that.
        raise RuntimeError(f"the checks of {path} failed: {complaints[-2000:]}")
    detail = "is damaged so badly that HDF5 doesn't come back from it. Restore it from a copy."
    return Verification(str(path), [Finding("file", "WRONG", detail)])


def _read(data: dict[str, Any]) -> Verification:
    """From plain data, as asdict() made it."""
    findings = [Finding(**one) for one in data.pop("findings")]
    return Verification(**data, findings=findings)


def _as_data(found: Verification) -> dict[str, Any]:
    return {
        "record": found.path,
        "is_well": found.is_well,
        "verdict": found.verdict,
        "state": found.state,
        "checks": [asdict(one) for one in found.findings],
        "not_stored": found.not_stored,
        "damaged": found.damaged,
        "go_on": found.go_on,
    }
