"""One fault in a command: what is told of it, what it leaves behind, and what is wrong with both.

The judge knows labapp by its command line alone: exit codes, what is printed, and what `verify`,
`resume` and a second try of the same command say once the disk is sound again.
"""

from __future__ import annotations

import errno
import json
import re
import shutil
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from small_bench.files import SmallFiles

from figures.faulty_calls import CUT, GONE, SHORT, STUCK, Fault
from figures.faulty_command import Ended, FaultyCommands

PLAN = """
version = 1
title = "Three frames"
[patterns.neutral]
kind = "constant"
[[acquire]]
targets = ["star"]
patterns = ["neutral"]
wavelengths_nm = [550]
exposures_ms = [1, 2, 8]
"""

FRAMES = 3

_CODES = (0, 1, 75)
"""Documented: all was done; not so; a run has waited too long."""

_OURS = ("Traceback", "unexpected", "report it", "Exception ignored", "Logging error")
"""What only a fault of the program prints."""

_CAUSES = {
    errno.EIO: "Input/output error|didn't keep",
    errno.ENOSPC: "No space left|is full|didn't keep",
    errno.EMFILE: "Too many open files",
    SHORT: "",
    **dict.fromkeys((GONE, STUCK, CUT), "its process|no answer|hangs"),
}

_REMEDY = re.compile(
    "labapp (resume|salvage|verify)|Choose another|Make space|Check the|Look at|Mend|Copy|Close|"
    "again|Save|Try",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Case:
    """A command with what it begins with. words: those after `labapp`. made: what it writes."""

    name: str
    words: list[str]
    begins_with: Path | None
    made: Path


@dataclass(frozen=True)
class Finding:
    """What came of a fault. wrong: what must not be; empty if all is right."""

    case: str
    fault: Fault
    ended: Ended
    wrong: str


class Workshop:
    """A folder in which commands are run with faults, and the records that they begin with.

    patience: seconds after which a command hangs.
    """

    def __init__(
        self, folder: Path, files: SmallFiles, commands: FaultyCommands, patience: float = 30.0
    ) -> None:
        self._patience = patience
        self._commands, self._kept = commands, folder / "kept"
        self.work = folder / "work"
        for one in (self._kept, self.work):
            one.mkdir()
        files.plan.write_text(PLAN)
        self._record = self.work / "run.h5"
        self._run = ["run", str(files.plan), *files.arguments(), "--wait-limit", "0.3"]
        self._run += ["--out", str(self._record)]
        commands.warm(self._run)
        self._reset(None)

    def cases(self) -> list[Case]:
        """The commands that write files, with a record to begin with where they need one."""
        whole = self._keep("whole.h5", None, None)
        cut = self._keep("cut.h5", whole, None)
        with cut.open("r+b") as file:
            file.truncate(cut.stat().st_size - 1000)
        # A run that ends before its first frame, because the disk runs full.
        count = self.run_once(self.run_case, Fault("write", 0, 0, False)).calls
        begun = self._keep("begun.h5", None, Fault("write", count * 9 // 10, errno.EIO, True))
        out = self.work / "out"
        record = str(self._record)
        exports = [
            Case(f"export {kind}", ["export", record, "--to", kind, "--out", str(out)], whole, out)
            for kind in ("tiff", "ome-tiff", "npy")
        ]
        saved = self.work / "saved.h5"
        return [
            self.run_case,
            Case("resume", ["resume", record, "--yes", "--wait-limit", "0.3"], begun, self._record),
            Case("salvage", ["salvage", record, "--out", str(saved)], cut, saved),
            *exports,
            Case(
                "merge",
                ["merge", record, "--out", str(self.work / "merged.h5")],
                whole,
                self.work / "merged.h5",
            ),
        ]

    @property
    def run_case(self) -> Case:
        return Case("run", self._run, None, self._record)

    def run_once(self, case: Case, fault: Fault) -> Ended:
        """Run a command from its beginning."""
        self._reset(case.begins_with)
        return self._commands.run(case.words, self.work, fault, self._patience)

    def judge(self, case: Case, fault: Fault) -> Finding:
        """Run a command with a fault, and look at what it says and leaves behind."""
        ended = self.run_once(case, fault)
        wrong = wrong_words(ended, fault)
        if not wrong and case.name in ("run", "resume"):
            wrong = self._wrong_record(case, ended)
        elif not wrong:
            wrong = self._wrong_files(case, ended)
        return Finding(case.name, fault, ended, wrong)

    def _wrong_record(self, case: Case, ended: Ended) -> str:
        """What is wrong with the record of a run, now and after it was resumed."""
        if not self._record.exists():
            if ended.acknowledged or "COMPLETE" in ended.printed or ended.code == 0:
                return "the record isn't there"
            # Nothing has happened; what couldn't be removed must not be in the way.
            return self._wrong_again(case) if [*self.work.iterdir()] else ""
        verified = self._verify()
        if ("COMPLETE" in ended.printed or ended.code == 0) and not verified["is_well"]:
            return f"false COMPLETE: {verified['verdict']}"
        lacks = {*verified["not_stored"], *verified["damaged"]}
        if lost := sorted({*ended.acknowledged} & lacks - _named(ended.told)):
            return f"acknowledged frames {lost} are lost untold"
        if not verified["is_well"]:
            resumed = self._sound("resume", str(self._record), "--yes")
            if resumed.code != 0:
                return f"not resumed: {resumed.told[-300:]}"
            verified = self._verify()
        return "" if verified["is_well"] else f"resumed, but: {verified['verdict']}"

    def _verify(self) -> dict[str, Any]:
        """What `verify` says of the record of a run, once the disk is sound again."""
        found: dict[str, Any] = json.loads(
            self._sound("verify", str(self._record), "--json").printed
        )
        return found

    def _wrong_files(self, case: Case, ended: Ended) -> str:
        """What is wrong with files that a command has written, and with its record."""
        if case.begins_with and _digest(self._record) != _digest(case.begins_with):
            return "the record that it reads has changed"
        if ended.code == 0 and _contents(case.made) != self._expected(case):
            return "ended with 0, and what it wrote isn't as it must be"
        # A record that is being salvaged appears before its frames, and can be told from it.
        by_parts = ended.code and case.name != "salvage" and _contents(case.made)
        # An export appears as a whole; of the files of a merge each does.
        if by_parts and not by_parts.items() <= self._expected(case).items():
            return "a part of a file was left"
        if by_parts and case.made.is_dir() and by_parts != self._expected(case):
            return "a part of what it writes was left"
        return self._wrong_again(case)

    def _expected(self, case: Case) -> dict[str, int]:
        kept = self._kept / f"{case.name}.made"
        if not kept.exists():
            held = self.work.rename(self.work.with_name("held"))
            self.work.mkdir()
            if case.begins_with:
                shutil.copy(case.begins_with, self._record)
            done = self._commands.run(case.words, self.work)
            assert done.code == 0, done
            kept.write_text(repr(_contents(case.made)))
            shutil.rmtree(self.work)
            held.rename(self.work)
        found: dict[str, int] = eval(kept.read_text())
        return found

    def _wrong_again(self, case: Case) -> str:
        """What is wrong with a second try, which doesn't begin anew."""
        forced = case.name != "resume"
        again = self._sound(*case.words, *(["--force"] if forced else []))
        if again.code != 0:
            return f"a second try fails: {again.told[-300:]}"
        strays = [one.name for one in self.work.rglob(".*")]
        return f"left behind: {', '.join(strays)}" if strays else ""

    def _keep(self, name: str, begins_with: Path | None, fault: Fault | None) -> Path:
        """Make a record to begin with, by a run with a fault, or a copy of another."""
        kept = self._kept / name
        if begins_with is not None:
            shutil.copy(begins_with, kept)
            return kept
        self.run_once(self.run_case, fault or Fault("write", 0, 0, False))
        shutil.move(self._record, kept)
        return kept

    def _sound(self, *words: str) -> Ended:
        return self._commands.run([*words], self.work)

    def _reset(self, begins_with: Path | None) -> None:
        shutil.rmtree(self.work)
        self.work.mkdir()
        if begins_with is not None:
            shutil.copy(begins_with, self._record)


def word_of_fault(said: str) -> str:
    """The first of the words that only a fault of the program prints; "" without any."""
    return next((word for word in _OURS if word in said), "")


def wrong_words(ended: Ended, fault: Fault) -> str:
    """What is wrong with how a command ended, by its exit code and its words."""
    if ended.code is None:
        return "hung"
    if ended.code < 0:
        return f"signal {-ended.code}"
    if ended.code not in _CODES:
        return f"exit code {ended.code}"
    if word := word_of_fault(ended.told + ended.printed):
        return f"says {word!r}"
    if ended.code and not ended.told.strip():
        return "silent"
    if ended.code and not re.search(_CAUSES[fault.cause], ended.told):
        return f"doesn't say the cause: {ended.told.strip()[-200:]}"
    if ended.code and not _REMEDY.search(ended.told):
        return f"says no remedy: {ended.told.strip()[-200:]}"
    return ""


def _named(told: str) -> set[int]:
    """The frames that a command has named as missing."""
    lists = re.findall(r"frames are missing \(([^)]*)\)", told)
    return {int(number) for number in re.findall(r"\d+", " ".join(lists))}


def _contents(path: Path) -> dict[str, int]:
    """Names and sizes of what a command has written: times differ from one to the next."""
    files = path.rglob("*") if path.is_dir() else path.parent.glob(f"{path.stem}*")
    shown = [one for one in files if "/." not in str(one.relative_to(path.parent.parent))]
    return {one.name: one.stat().st_size for one in shown if one.is_file()}


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest() if path.exists() else ""
