"""What the design of patterns for an extended depth of field reaches, against its time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import torch

from labapp.accuracy.edof_case import EdofCase
from labapp.accuracy.measuring_loop import measure_rows
from labapp.accuracy.row_output import Columns, format_number
from labapp.accuracy.work_precision import CALLS, ENDLESS, Deadline, Row
from labapp.common.errors import UserError
from optics.edof.depth_bound import known_depth_bound
from optics.edof.dioptres import random_dioptres
from optics.edof.pattern_rating import SearchSettings, rate_pattern
from optics.edof.pattern_search import RATED_DEPTHS, design_pattern
from optics.edof.picture_spectrum import FrequencyGrid
from optics.progress import Progress

STEPS = (10, 30, 100, 300, 1000)
"""Numbers of steps that may be measured; chosen."""

_USUAL = ("quarter", "rings", SearchSettings().depths)
"""The parametrisation, the start and the depths per step of `labapp design edof`."""

_VARIANTS = (
    _USUAL,
    ("radial", "rings", _USUAL[2]),
    ("quarter", "sweep", _USUAL[2]),
    ("quarter", "rings", 1),
    ("quarter", "rings", 6),
    ("free", "rings", _USUAL[2]),
)
"""What is measured: the usual design, and others that differ from it in one choice."""

_SLOW_STEPS = 3
"""Factor by which designs with more work per step take fewer steps at most; chosen."""

_RATING_SEED, _SEED = 2, 1
"""Seeds of the depths at which designs are rated, and of those by which they are searched."""

ERROR_NAME = "level below the bound, dB"
"""The bound is what no pattern can pass with the depth known; the level is the design's PSNR."""


@dataclass(frozen=True)
class DesignRow(Row):
    """Measured quality and time of a designed pattern after a number of steps.

    error_achieved: `bound_db`, which no pattern can pass, with the depth known, less `level_db`. A
    blind filter for all depths doesn't come near zero.
    iterations: steps of the search.
    level_db, start_db: expected PSNR of one filter for all depths, at depths that the search didn't
    use: for the found pattern, and for that from which the search starts.
    """

    iterations: int = 0
    level_db: float | None = None
    start_db: float | None = None
    bound_db: float | None = None


COLUMNS: Columns[DesignRow] = {
    "design": lambda row: row.method,
    "steps ": lambda row: str(row.iterations),
    "PSNR dB ": lambda row: "failed" if row.failure else format_number(row.level_db, ".2f"),
    "start ": lambda row: format_number(row.start_db, ".2f"),
    "below bound ": lambda row: format_number(row.error_achieved, ".2f"),
    "CPU s ": lambda row: format_number(row.cpu_s, ".2f"),
    "": lambda row: "front" if row.on_front else "",
}

REMARK = (
    "PSNR: expected of one filter for all depths, at 64 random depths that the search didn't use. "
    "below bound: what no pattern can pass with the depth known, less this; it decides the front "
    "with the time of the search. One thread."
)


def measure_designs(
    case: EdofCase, most_steps: int, progress: Progress, deadline: Deadline = ENDLESS
) -> list[DesignRow]:
    """Measure the level and time of designs after more and more steps, at most `most_steps`.

    Raises UserError if no pattern can be designed for the camera.
    """
    try:
        # The level in dB that no pattern can pass with the depth known.
        problem, grid = case.problem("rings", "quarter"), FrequencyGrid(case.size, quarter=True)
        limit = problem.limit(case.wavelength)
        bound = known_depth_bound(limit, problem.spectrum_on(grid), grid.shares(), case.noise)
    except ValueError as error:
        raise UserError(f"no pattern is designed for this camera: {error}.") from error
    planned, measure = list(_planned_rows(case, most_steps)), partial(_measure, case, bound)
    if not deadline.is_over:
        # A single step, so that what is loaded at first is in no row's time.
        with suppress(ValueError):
            row, variant = planned[0]
            measure(replace(row, iterations=1), variant, Progress())
    return measure_rows(
        planned, measure, lambda row: f"{row.method}, {row.iterations} steps", progress, deadline
    )


def _planned_rows(
    case: EdofCase, most_steps: int
) -> Iterator[tuple[DesignRow, tuple[str, str, int]]]:
    """Yield the rows to fill, each with its way to design; long searches come last."""
    counts = [count for count in STEPS if count <= most_steps] or [most_steps]
    # Free patterns take so long that one number of steps must do.
    slow = max((one for one in counts if one <= most_steps / _SLOW_STEPS), default=counts[0])
    for count in counts:
        for variant in _VARIANTS:
            parametrisation, start, depths = variant
            if parametrisation == "free" and count != slow:
                continue
            if depths > _USUAL[2] and count > slow:
                continue
            words = f"{parametrisation}, {start}, {depths} depth{'s' if depths > 1 else ''} a step"
            row = DesignRow(
                "edof-design", case.camera_name, words, "float32", None, iterations=count
            )
            yield replace(row, chosen_for=CALLS[-1:] if variant == _USUAL else ()), variant


def _measure(
    case: EdofCase, bound: float, row: DesignRow, variant: tuple[str, str, int], progress: Progress
) -> DesignRow:
    """Design a pattern in one way, and measure its level and time."""
    parametrisation, start, depths = variant
    problem = case.problem(start, parametrisation)
    transfer = problem.transfer(case.wavelength)
    spectrum = problem.spectrum_on(transfer.grid)
    parameters = problem.parametrisation.fit(problem.start_phase())
    began, wall = time.process_time(), time.perf_counter()
    found = design_pattern(
        transfer,
        parameters,
        spectrum,
        case.noise,
        steps=row.iterations,
        generator=torch.Generator().manual_seed(_SEED),
        pattern=problem.phase,
        depth_range=problem.depth_range,
        settings=SearchSettings(depths=depths),
        progress=progress,
    )
    spent, wall = time.process_time() - began, time.perf_counter() - wall
    others = random_dioptres(
        RATED_DEPTHS, torch.Generator().manual_seed(_RATING_SEED), problem.depth_range
    )
    began = time.process_time()
    level = rate_pattern(transfer, found.phase, spectrum, case.noise, others).blind
    rating = time.process_time() - began
    return replace(
        row,
        error_achieved=bound - level,
        bound_db=bound,
        # The search itself rates its start and its result, at as many depths.
        cpu_s=max(spent - 2 * rating, spent / row.iterations / 10),
        wall_s=wall,
        level_db=level,
        start_db=found.start_rating.blind,
    )
