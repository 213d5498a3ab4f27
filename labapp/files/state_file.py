"""The state of long work, kept beside its result, so that it can go on."""

from __future__ import annotations

import io
import pickle
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from labapp.common.errors import UserError
from labapp.files.array_file import require_plain_zip
from labapp.files.writing import write_atomically

WRITE_INTERVAL = 20.0
"""Seconds between two writings of a state. Chosen: at most so much work is lost."""


class StateFile:
    """Keeps the state of long work on the disk, and reads it again.

    The settings of the work are kept beside its state. A state replaces the one before when it is
    complete, so that work that is killed at any moment leaves one of the two.

    work: what the work is in one word, for messages: "design" or "training".
    """

    def __init__(self, path: Path, work: str) -> None:
        self.path, self.work = path, work
        self._written = time.monotonic()

    def read_settings(self) -> dict[str, Any] | None:
        """Return the kept work's settings, "steps" among them, or None; UserError for damage."""
        stored = self._load()
        return None if stored is None else dict(stored["settings"])

    def read_steps(self) -> int | None:
        """Return how many steps the kept work has in all, or None; UserError for damage."""
        settings = self.read_settings()
        return None if settings is None else int(settings["steps"])

    def read(self, settings: Mapping[str, Any]) -> dict[str, Any] | None:
        """Read the state of kept work with these settings; None without kept work.

        Its tensors are on the CPU. Raises UserError if the file is damaged, or of work with other
        settings, and ValueError if the settings aren't plain data, which could be written and not
        be read again.

        settings: everything that the work depends on, as plain data, with "steps", those in all.
        """
        _require_plain(settings)
        stored = self._load()
        if stored is None:
            return None
        found = stored["settings"]
        names = sorted(found.keys() | settings.keys())
        changed = [
            f"{name} {found.get(name)} instead of {settings.get(name)}"
            for name in names
            if name not in found or name not in settings or found[name] != settings[name]
        ]
        if changed:
            raise UserError(
                f"{self.path}: belongs to a {self.work} with {', '.join(changed)}. Repeat that "
                "command to go on, or delete the file."
            )
        state: dict[str, Any] = stored["state"]
        return state

    def write(self, settings: Mapping[str, Any], state: Mapping[str, Any]) -> None:
        """Write the state of work with these settings, in place of the one before.

        Raises UserError if that fails, such as on a full disk; the state before is then kept.
        """
        buffer = io.BytesIO()
        torch.save({"settings": dict(settings), "state": dict(state)}, buffer)
        try:
            write_atomically(self.path, buffer.getvalue())
        except OSError as error:
            raise UserError(
                f"{self.path}: the state of the {self.work} can't be written: {error.strerror}. "
                "Make space or mend the folder, and repeat the command: it goes on from the state "
                "that was written before."
            ) from error
        self._written = time.monotonic()

    def is_due(self) -> bool:
        """Whether the state was written so long ago that it should be written again."""
        return time.monotonic() - self._written >= WRITE_INTERVAL

    def delete(self) -> None:
        """Delete the state of work whose result is written."""
        self.path.unlink(missing_ok=True)

    def describe_damage(self, error: Exception) -> UserError:
        """Return the error that says that this state is damaged, and what to do."""
        reason = str(error).partition("\n")[0] or type(error).__name__
        return UserError(
            f"{self.path}: is damaged ({reason}). Delete it to start the {self.work} anew."
        )

    def _load(self) -> dict[str, Any] | None:
        """Return settings and state as they are stored; None if there are none."""
        if not self.path.exists():
            return None
        require_plain_zip(self.path)
        try:
            stored = torch.load(self.path, map_location="cpu", weights_only=True)
            return {
                "settings": {**stored["settings"], "steps": int(stored["settings"]["steps"])},
                "state": dict(stored["state"]),
            }
        except _DAMAGE as error:
            raise self.describe_damage(error) from error


def _require_plain(settings: Mapping[str, Any]) -> None:
    """Raise ValueError if settings hold more than plain data."""
    buffer = io.BytesIO()
    torch.save(dict(settings), buffer)
    buffer.seek(0)
    try:
        torch.load(buffer, weights_only=True)
    except pickle.UnpicklingError as error:
        raise ValueError(
            f"settings are {dict(settings)}; give numbers, strings, lists and dicts of them only"
        ) from error


_DAMAGE = (
    OSError, EOFError, RuntimeError, LookupError, TypeError, ValueError, AttributeError,
    pickle.UnpicklingError,
)  # fmt: skip
"""What loading damaged data raises."""
