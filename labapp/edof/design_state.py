"""Keep the state of a search in a file beside the result, so that it can go on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from labapp.files.state_file import StateFile
from optics.edof.pattern_rating import SearchState


class DesignStateFile:
    """Writes the state of a search to a file now and then, and reads it again.

    settings: everything that the design depends on, as plain data, with "steps", those of the
        search in all. A state of other settings is refused.
    """

    def __init__(self, file: StateFile, settings: Mapping[str, Any]) -> None:
        self._file, self._settings = file, settings

    def read(self) -> SearchState | None:
        """Return the state of an interrupted search, or None without one.

        Raises UserError if the file is damaged, or of a design with other settings.
        """
        stored = self._file.read(self._settings)
        try:
            return None if stored is None else SearchState(**stored)
        except TypeError as error:
            raise self._file.describe_damage(error) from error

    def write(self, state: SearchState) -> None:
        """Write the state; UserError if that fails."""
        self._file.write(
            self._settings, {one.name: getattr(state, one.name) for one in fields(state)}
        )

    def write_if_due(self, state: SearchState) -> None:
        """Write the state if the last time is long ago."""
        if state.step and self._file.is_due():
            self.write(state)
