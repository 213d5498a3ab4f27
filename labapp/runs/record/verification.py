"""The findings of a record's verification, and the verdict for the user."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from labapp.common.plain_text import shell_word
from labapp.runs.state import State

_FIXED_BY_RESUME = {
    "frames", "checksums", "settings", "camera", "digests", "state", "closing", "copy"
}  # fmt: skip
"""Checks that pass again when a run is resumed, which mends its record and takes frames."""


def advise_salvage(path: Path | str) -> str:
    """Say what to do about a damaged file, as a sentence."""
    command = f"labapp salvage {shell_word(str(path))} --out FILE"
    return f"Restore it from a copy, or save its frames with: {command}"


_TORN = {"log"}
"""The same of a run that hasn't ended: its last lines weren't on the disk."""

CheckStatus = Literal["ok", "note", "unfinished", "WRONG"]

StatusAndDetail = tuple[CheckStatus, str]
"""The status of a check, and its details in words."""


@dataclass(frozen=True)
class RecordFinding:
    """What one check found; "note" means a remark that isn't an error."""

    check: str
    result: CheckStatus
    detail: str


@dataclass
class Verification:
    """The findings of all checks.

    is_being_written: whether a process still writes the record.
    not_stored: indices of planned frames that aren't in the record.
    damaged: indices of frames that don't have their checksum.
    """

    path: str
    findings: list[RecordFinding] = field(default_factory=list)
    state: str | None = None
    is_being_written: bool = False
    not_stored: list[int] = field(default_factory=list)
    damaged: list[int] = field(default_factory=list)

    @property
    def failed_checks(self) -> list[str]:
        """Names of the checks that failed."""
        return [one.check for one in self.findings if one.result == "WRONG"]

    @property
    def is_in_order(self) -> bool:
        """Whether all checks passed."""
        return all(one.result in ("ok", "note") for one in self.findings)

    @property
    def resume_command(self) -> str | None:
        """The command that completes the record; None if none is needed, or none can."""
        has_ended = self.state is not None and State(self.state).has_ended
        fixed = _FIXED_BY_RESUME | (set() if has_ended else _TORN)
        if self.is_in_order or self.is_being_written or set(self.failed_checks) - fixed:
            return None
        return f"labapp resume {shell_word(self.path)}"

    @property
    def reason(self) -> str:
        """What is wrong or lacking, in words; empty if all is in order."""
        bad = [one for one in self.findings if one.result == "WRONG"] or [
            one for one in self.findings if one.result == "unfinished"
        ]
        return "; ".join(f"{one.check}: {one.detail}" for one in bad)

    @property
    def verdict(self) -> str:
        """One line for the user on the condition of the file and what to do."""
        if self.is_in_order:
            return f"{self.path}: in order, {self.state}."
        if self.failed_checks == ["file"]:
            return f"{self.path}: NOT IN ORDER: it {self.findings[0].detail}"
        if self.failed_checks:
            remedy = advise_salvage(self.path)
            if self.resume_command:
                what = (
                    "take again what is missing" if self.not_stored or self.damaged else "mend it"
                )
                remedy = f"To {what}: {self.resume_command}"
            return f"{self.path}: NOT IN ORDER: {', '.join(self.failed_checks)}. {remedy}"
        if self.is_being_written:
            return f"{self.path}: still {self.state}. Verify it again when the run has ended."
        return (
            f"{self.path}: unfinished; what is there is in order. To go on: {self.resume_command}"
        )
