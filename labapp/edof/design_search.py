"""Search for a pattern that extends a bench's depth of field, and keep the search's state."""

from __future__ import annotations

import torch

from labapp.edof.design_problem import EdofProblem
from labapp.edof.design_state import DesignStateFile
from optics.edof.pattern_rating import DesignResult, SearchState
from optics.edof.pattern_search import design_pattern
from optics.edof.pattern_transfer import PatternTransfer
from optics.progress import Cancelled, Progress


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
