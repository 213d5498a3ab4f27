"""Requested runs that haven't ended, kept in a file over crashes."""

from __future__ import annotations

import json
import logging
import os
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from labapp.common.errors import UserError
from labapp.files.guarded_reading import open_regular
from labapp.files.plain_data import parse_json
from labapp.files.write_locks import close_locked, lock_file
from labapp.files.writing import write_atomically
from labapp.window.commands import AcquireBracket, KeptRequest, ResumeRun, RunPlan, RunRequest
from labapp.window.exposure_bracket import ExposureBracket, RequestedBracket, SNRBracket
from labapp.window.messages import QueueState

log = logging.getLogger(__name__)

_MOST_BYTES = 1 << 20
"""Bytes that the file may have: thousands of runs. Chosen."""

_BRACKETS: dict[str, type[RequestedBracket]] = {"ladder": ExposureBracket, "snr": SNRBracket}


class KeptQueue:
    """Keep each request for a run from the moment it is made until its run has ended.

    Every change is in the file before the engine hears of it, so that a window or an engine that is
    killed at any moment loses none. Of several windows that share the file, the first one has it.
    Another one keeps its queue over crashes of its engine only.
    file: its folder is made.
    bench: name of the bench, whose runs are given back on it alone.
    """

    def __init__(self, file: Path, bench: str) -> None:
        self._file, self._bench = file, bench
        self._seen: set[str] = set()
        self._last_stamp, self._count = "", 0
        self._lock = _lock(file)
        self._others: list[dict[str, Any]] = []
        self._kept: dict[str, KeptRequest] = {}
        if self._lock is not None:
            self._read()

    def new_ticket(self) -> str:
        """Return a name for a new run: the present second, and a number if needed."""
        stamp = f"{datetime.now():%Y-%m-%d_%H%M%S}"
        self._count = self._count + 1 if stamp == self._last_stamp else 1
        self._last_stamp = stamp
        return stamp if self._count == 1 else f"{stamp}-{self._count}"

    def add(self, request: RunRequest) -> None:
        """Keep a request that is about to be sent to the engine."""
        self._kept[request.ticket] = KeptRequest(request)
        self._write()

    def drop(self, ticket: str) -> None:
        """Forget a request that the engine has refused."""
        if self._kept.pop(ticket, None) is not None:
            self._write()

    def follow(self, queue: QueueState) -> None:
        """Note where runs are written, and forget those that ended or were removed."""
        before = dict(self._kept)
        for run in queue.runs:
            if run.ticket not in self._kept:
                continue
            if run.state.has_ended:
                del self._kept[run.ticket]
            elif self._kept[run.ticket].path != run.path:
                self._kept[run.ticket] = replace(self._kept[run.ticket], path=run.path)
        present = {run.ticket for run in queue.runs}
        for ticket in self._seen - present:
            self._kept.pop(ticket, None)
        self._seen = present
        if self._kept != before:
            self._write()

    def forget_engine(self) -> None:
        """Note that the engine has ended: that its runs are gone says nothing of them."""
        self._seen = set()

    def close(self) -> None:
        """Leave the file to the next window; what it holds stays."""
        if self._lock is not None:
            close_locked(self._lock)
            self._lock = None

    @property
    def requests(self) -> tuple[KeptRequest, ...]:
        """Return the kept requests in the order in which they were made."""
        return tuple(self._kept.values())

    def _read(self) -> None:
        try:
            with open_regular(self._file, _MOST_BYTES) as file:
                data = parse_json(file.read().decode(), str(self._file))
            listed = data["runs"]
            for table in listed:
                if table["bench"] != self._bench:
                    self._others.append(table)
                    continue
                kept = _from_table(table)
                self._kept[kept.request.ticket] = kept
        except (UserError, KeyError, TypeError, ValueError) as error:
            if self._file.exists():
                log.warning("%s: the kept queue can't be used: %s", self._file, error)

    def _write(self) -> None:
        if self._lock is None:
            return
        listed = [{"bench": self._bench} | _to_table(kept) for kept in self._kept.values()]
        text = json.dumps({"version": 1, "runs": [*self._others, *listed]}, indent=1)
        try:
            write_atomically(self._file, text.encode())
        except OSError as error:
            log.warning("%s: the queue can't be kept: %s", self._file, error)


def _lock(file: Path) -> int | None:
    """Lock the file as long as this process lives; None if it is taken."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(file.with_suffix(".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        log.warning("%s: the queue can't be kept: %s", file, error)
        return None
    try:
        if lock_file(handle):
            return handle
        told = "another window keeps its queue there"
    except OSError as error:
        told = f"the queue can't be kept: {error.strerror}"
    os.close(handle)
    log.warning("%s: %s", file, told)
    return None


def _to_table(kept: KeptRequest) -> dict[str, Any]:
    """Return a request as plain data."""
    request = kept.request
    table: dict[str, Any] = {"ticket": request.ticket, "path": str(kept.path or "")}
    if isinstance(request, AcquireBracket):
        return table | {
            "kind": "bracket",
            "pattern": request.pattern,
            "wavelength": request.wavelength,
            "star": _bracket_to_table(request.star),
            "photograph": _bracket_to_table(request.photograph),
            "folder": str(request.folder),
        }
    if isinstance(request, RunPlan):
        return table | {
            "kind": "plan",
            "plan": str(request.plan.absolute()),
            "folder": str(request.folder),
        }
    return table | {"kind": "resume", "record": str(request.path.absolute())}


def _from_table(table: dict[str, Any]) -> KeptRequest:
    """Return the request that is kept in a table; KeyError or ValueError if it is none."""
    ticket, kind = str(table["ticket"]), table["kind"]
    path = Path(table["path"]) if table["path"] else None
    request: RunRequest
    if kind == "bracket":
        request = AcquireBracket(
            pattern=dict(table["pattern"]),
            wavelength=float(table["wavelength"]),
            star=_bracket_from_table(table["star"]),
            photograph=_bracket_from_table(table["photograph"]),
            folder=Path(table["folder"]),
            ticket=ticket,
        )
    elif kind == "plan":
        request = RunPlan(Path(table["plan"]), Path(table["folder"]), ticket=ticket)
    elif kind == "resume":
        request = ResumeRun(Path(table["record"]), ticket=ticket)
    else:
        raise ValueError(f"{kind!r} is no kind of run")
    return KeptRequest(request, path)


def _bracket_to_table(bracket: RequestedBracket) -> dict[str, Any]:
    kind = "snr" if isinstance(bracket, SNRBracket) else "ladder"
    return {"kind": kind} | asdict(bracket)


def _bracket_from_table(table: dict[str, Any]) -> RequestedBracket:
    values = {name: value for name, value in table.items() if name != "kind"}
    return _BRACKETS[table["kind"]](**values)
