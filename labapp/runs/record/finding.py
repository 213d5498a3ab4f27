"""What the checks of a record found, and what a person is told of it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from typing import Literal

_RETAKEN = {"frames", "checksums", "state"}
"""Checks that are passed again when the frames that are missing have been taken again."""

Result = Literal["ok", "note", "unfinished", "WRONG"]


@dataclass(frozen=True)
class Finding:
    """What one check found. note: worth knowing, and no fault of the record."""

    check: str
    result: Result
    detail: str


@dataclass
class Verification:
    """All findings. live: whether a process still writes the record.

    not_stored, damaged: indices of frames that are planned and not in the record, and of
    those in it that don't read back.
    """

    path: str
    findings: list[Finding] = field(default_factory=list)
    state: str | None = None
    live: bool = False
    not_stored: list[int] = field(default_factory=list)
    damaged: list[int] = field(default_factory=list)

    @property
    def wrong(self) -> list[str]:
        """The checks that failed."""
        return [one.check for one in self.findings if one.result == "WRONG"]

    @property
    def is_well(self) -> bool:
        return all(one.result in ("ok", "note") for one in self.findings)

    @property
    def go_on(self) -> str | None:
        """The command that makes the record whole, if one can."""
        if self.is_well or self.live or set(self.wrong) - _RETAKEN:
            return None
        return f"labapp resume {shlex.quote(self.path)}"

    @property
    def verdict(self) -> str:
        """One line for a person: how the record is, and what to do."""
        if self.is_well:
            return f"{self.path}: in order, {self.state}."
        if self.wrong == ["file"]:
            return f"{self.path}: NOT IN ORDER: it {self.findings[0].detail}"
        if self.wrong:
            remedy = "Restore it from a copy, or run its plan again."
            if self.go_on:
                remedy = f"To take again what is missing: {self.go_on}"
            return f"{self.path}: NOT IN ORDER: {', '.join(self.wrong)}. {remedy}"
        if self.live:
            return f"{self.path}: still {self.state}. Verify it again when the run has ended."
        return f"{self.path}: unfinished; what is there is in order. To go on: {self.go_on}"
