"""Keep the state of a pattern's design in a file beside the result, so that it can go on."""

from __future__ import annotations

import io
import pickle
import time
from dataclasses import fields
from pathlib import Path
from typing import Any

import torch

from labapp.common.errors import UserError
from labapp.files.writing import write_atomically
from optics.edof.search_state import SearchState

_INTERVAL = 20.0
"""Seconds between two writings of the state. Chosen: at most so much is lost."""


class DesignStateFile:
    """Writes the state of a design to a file now and then, and reads it again.

    Parameters
    ----------
    path : Path
        The file.
    settings : dict
        Everything that the design depends on, as plain data. A state of other settings is refused.

    Attributes
    ----------
    steps : int or None
        Steps of the search in all; None before they are known.
    """

    def __init__(self, path: Path, settings: dict[str, Any]) -> None:
        self.path, self._settings = path, settings
        self.steps: int | None = None
        self._written = time.monotonic()

    def read(self) -> SearchState | None:
        """Return the state of an interrupted design, or None without one.

        Raises UserError if the file is damaged, or of a design with other settings.
        """
        if not self.path.is_file():
            return None
        try:
            stored = torch.load(self.path, weights_only=True)
            found, state = stored["settings"], SearchState(**stored["state"])
            self.steps = stored["steps"]
        except (OSError, RuntimeError, pickle.UnpicklingError, KeyError, TypeError) as error:
            raise UserError(
                f"{self.path}: is damaged ({error}). Delete it to start the design anew."
            ) from error
        changed = sorted(name for name in self._settings if found.get(name) != self._settings[name])
        if changed:
            name = changed[0]
            raise UserError(
                f"{self.path}: belongs to a design with {name} {found.get(name)} instead of "
                f"{self._settings[name]}. Repeat that command to go on, or delete the file."
            )
        return state

    def write(self, state: SearchState) -> None:
        """Write the state of a design to the file."""
        kept = {one.name: getattr(state, one.name) for one in fields(state)}
        buffer = io.BytesIO()
        torch.save({"settings": self._settings, "steps": self.steps, "state": kept}, buffer)
        write_atomically(self.path, buffer.getvalue())
        self._written = time.monotonic()

    def write_if_due(self, state: SearchState) -> None:
        """Write the state of a design if the last time is long ago."""
        if state.step and time.monotonic() - self._written >= _INTERVAL:
            self.write(state)

    def delete(self) -> None:
        """Delete the file of a design that is finished."""
        self.path.unlink(missing_ok=True)
