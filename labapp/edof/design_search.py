"""Search for a pattern that extends a bench's depth of field, and keep the search's state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import torch

from labapp.edof.design_problem import EdofProblem
from labapp.files.state_file import StateFile
from optics.edof.pattern_rating import DesignResult, SearchState
from optics.edof.pattern_search import design_pattern
from optics.edof.pattern_transfer import PatternTransfer
from optics.progress import Cancelled, Progress


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


def search_pattern(
    problem: EdofProblem,
    transfer: PatternTransfer,
    start: torch.Tensor,
    steps: int,
    state: SearchState,
    kept: DesignStateFile,
    progress: Progress,
) -> DesignResult:
    """Search for a pattern, and keep the state now and then, and when the search is cancelled.

    transfer: the optics at the first wavelength.
    start: parameters to start from.
    steps: of the search in all.
    state: to go on from; it is changed in place.
    """

    def report(fraction: float, message: str) -> None:
        kept.write_if_due(state)
        progress.report(fraction, message)

    request = problem.request
    try:
        return design_pattern(
            transfer,
            start,
            problem.spectrum_on(transfer.grid),
            request.noise,
            steps=steps,
            generator=torch.Generator().manual_seed(request.seed),
            criterion=request.decoder,
            pattern=problem.phase,
            further_bands=problem.further_bands(),
            depth_range=problem.depth_range,
            progress=Progress(report),
            state=state,
        )
    except Cancelled:
        if state.step:
            kept.write(state)
        raise
