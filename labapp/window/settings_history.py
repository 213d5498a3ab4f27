"""The history of the bench's settings, for undo and redo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

DEPTH = 100
"""Changes that can be undone. Chosen: an hour's work at one change in half a minute."""


@dataclass(frozen=True)
class SettingChange:
    """A change of one of the bench's settings: its name, and its value before and after.

    A pattern's value is its number in the engine; wavelengths are in metres, exposures in seconds.
    """

    name: str
    before: Any
    after: Any


class SettingsHistory:
    """Keep the changes of the bench's settings in their order, as the person made them.

    A setting that the history doesn't know yet begins with the first value that is noted, and with
    no change.
    values: present value of each setting.
    """

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}
        self._done: list[SettingChange] = []
        self._undone: list[SettingChange] = []

    @property
    def next_undo(self) -> SettingChange | None:
        """Return the change that undo() would take back; None if there is none."""
        return self._done[-1] if self._done else None

    @property
    def next_redo(self) -> SettingChange | None:
        """Return the change that redo() would make again; None if there is none."""
        return self._undone[-1] if self._undone else None

    def clear(self) -> None:
        """Forget all changes and values, since the bench may have any other now."""
        self.values.clear()
        self._done.clear()
        self._undone.clear()

    def note(self, name: str, value: Any) -> None:
        """Note that the person has set a setting; what was undone can't be made again then."""
        before = self.values.setdefault(name, value)
        if value == before:
            return
        self.values[name] = value
        self._done.append(SettingChange(name, before, value))
        del self._done[:-DEPTH]
        self._undone.clear()

    def undo(self) -> SettingChange | None:
        """Take back the last change: the caller sets its value before."""
        if not self._done:
            return None
        change = self._done.pop()
        self._undone.append(change)
        self.values[change.name] = change.before
        return change

    def redo(self) -> SettingChange | None:
        """Make the change again that was undone last: the caller sets its value."""
        if not self._undone:
            return None
        change = self._undone.pop()
        self._done.append(change)
        self.values[change.name] = change.after
        return change
