"""What the checks of a record found, and what a person is told of it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from typing import Literal

_FIXED_BY_RESUME = {"frames", "checksums", "state"}
"""Checks that are passed again when the frames that are missing have been taken again."""

CheckStatus = Literal["ok", "note", "unfinished", "WRONG"]


@dataclass(frozen=True)
class RecordFinding:
    """What one check found. note: worth knowing, and no fault of the record."""

    check: str
    result: CheckStatus
    detail: str


@dataclass
class Verification:
    """All findings. is_being_written: whether a process still writes the record.

    not_stored, damaged: indices of frames that are planned and not in the record, and of
    those in it that don't read back.
    """

    path: str
    findings: list[RecordFinding] = field(default_factory=list)
    state: str | None = None
    is_being_written: bool = False
    not_stored: list[int] = field(default_factory=list)
    damaged: list[int] = field(default_factory=list)

    @property
    def failed_checks(self) -> list[str]:
        """The checks that failed."""
        return [one.check for one in self.findings if one.result == "WRONG"]

    @property
    def is_in_order(self) -> bool:
        return all(one.result in ("ok", "note") for one in self.findings)

    @property
    def resume_command(self) -> str | None:
        """The command that makes the record whole, if one can."""
        if self.is_in_order or self.is_being_written or set(self.failed_checks) - _FIXED_BY_RESUME:
            return None
        return f"labapp resume {shlex.quote(self.path)}"

    @property
    def verdict(self) -> str:
        """One line for a person: how the record is, and what to do."""
        if self.is_in_order:
            return f"{self.path}: in order, {self.state}."
        if self.failed_checks == ["file"]:
            return f"{self.path}: NOT IN ORDER: it {self.findings[0].detail}"
        if self.failed_checks:
            remedy = "Restore it from a copy, or run its plan again."
            if self.resume_command:
                remedy = f"To take again what is missing: {self.resume_command}"
            return f"{self.path}: NOT IN ORDER: {', '.join(self.failed_checks)}. {remedy}"
        if self.is_being_written:
            return f"{self.path}: still {self.state}. Verify it again when the run has ended."
        return (
            f"{self.path}: unfinished; what is there is in order. To go on: {self.resume_command}"
        )
