"""Measures iterative methods one after the other, each at one setting, until a deadline."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

from labapp.accuracy.work_precision import CUT, ENDLESS, Deadline, R, mark_front
from optics.progress import Progress

A = TypeVar("A")
C = TypeVar("C")

_REPEATS = 3
"""Timed answers of a short method, of which the median counts; chosen."""


def measure_rows(
    cases: Sequence[tuple[R, C]],
    measure: Callable[[R, C, Progress], R],
    describe: Callable[[R], str],
    progress: Progress,
    deadline: Deadline = ENDLESS,
    refusals: tuple[type[Exception], ...] = (ValueError,),
) -> list[R]:
    """Measure each case, and mark the rows that no other row beats in both time and error.

    What is left at the deadline is named as cut.
    cases: rows to fill, each with what `measure` needs for it.
    measure: returns the filled row; an error among `refusals` is named in the row instead.
    describe: says for the progress what a row is of.
    """
    rows = list[R]()
    for number, (row, case) in enumerate(cases):
        part = progress.part(number / len(cases), (number + 1) / len(cases))
        part.report(0.0, describe(row))
        try:
            filled = replace(row, failure=CUT) if deadline.is_over else measure(row, case, part)
        except refusals as error:
            filled = replace(row, failure=str(error))
        rows.append(filled)
    return mark_front(rows)


def time_answers(answer: Callable[[], A], short_s: float) -> tuple[A, float, float]:
    """Return an answer, the median processor seconds of one, and the mean wall-clock seconds.

    An answer that takes less than `short_s` processor seconds is computed several times.
    """
    times, wall = list[float](), time.perf_counter()
    while not times or (times[0] < short_s and len(times) < _REPEATS):
        started = time.process_time()
        found = answer()
        times.append(time.process_time() - started)
    return found, statistics.median(times), (time.perf_counter() - wall) / len(times)
