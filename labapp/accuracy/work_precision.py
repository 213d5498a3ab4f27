"""Measure the points of a work-precision diagram, and mark those on its front."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any, TypeVar

import numpy as np

from labapp.accuracy.calibration_kernel import CalibrationKernel
from optics.progress import Progress
from optics.propagation.free_space_operator import FreeSpace
from optics.psf import PSFOperator

Operator = TypeVar("Operator", PSFOperator, FreeSpace)


@dataclass(frozen=True)
class CallTimingSettings:
    """Tune how the time of a call is measured.

    Attributes
    ----------
    repeats : int
        Measurements of each call, of which the median counts. Chosen.
    least_s : float
        Least processor time of a measurement in seconds; short calls are repeated until they add
        up to it. Chosen so that the steps of the clock don't matter.
    """

    repeats: int = 5
    least_s: float = 0.02


@dataclass(frozen=True)
class RetimingSettings:
    """Tune how often a slow method is timed.

    Attributes
    ----------
    short_s : float
        Processor time in seconds below which a method is timed `repeats` times; a slower one is
        timed once. Chosen.
    repeats : int
        Measurements of a short method, of which the median counts. Chosen.
    """

    short_s: float
    repeats: int = 3


_TIMING = CallTimingSettings()


@dataclass(frozen=True)
class Row:
    """Measured error and time of a method at one setting.

    Attributes
    ----------
    operation, case, method, precision : str
        What was computed, for which case, how, and in which number format.
    tol : float or None
        Requested tolerance; None for methods that take none.
    error_achieved, error_predicted : float or None
        Relative L2 error.
    cpu_s, wall_s : float or None
        Processor and wall-clock time of one call in seconds, without planning.
    peak_bytes : int or None
        Size of the largest arrays, as the method accounts for them.
    on_front : bool
        Whether no other row is both faster and more accurate.
    failure : str
        Why the method gave no result; empty if it gave one.
    """

    operation: str
    case: str
    method: str
    precision: str
    tol: float | None
    error_achieved: float | None = None
    error_predicted: float | None = None
    cpu_s: float | None = None
    wall_s: float | None = None
    peak_bytes: int | None = None
    on_front: bool = False
    failure: str = ""


@dataclass(frozen=True)
class Candidate:
    """A row to be measured; `plan()` returns the call, its predicted error and its bytes."""

    row: Row
    plan: Callable[[], tuple[Callable[[], Any], float | None, int]]


def raise_refusal(error: Exception) -> tuple[Callable[[], Any], float | None, int]:
    """Raise a method's earlier refusal, so that its message becomes the accuracy row's failure.

    The refusal is the error that planning raised.
    """
    raise error


def candidates_by_tolerance(
    case: Row,
    methods: Iterable[str],
    tolerances: Iterable[float],
    plan: Callable[..., Operator],
    build_call: Callable[[Operator], Callable[[], Any]],
) -> Iterator[Candidate]:
    """Yield every method at every tolerance as a candidate row of a work-precision diagram.

    A method that refuses gives a row with the reason.

    Parameters
    ----------
    case : Row
        Row that names operation and case.
    methods : iterable of str
        Names of methods.
    tolerances : iterable of float
        Relative L2 errors to request.
    plan : callable
        Returns an operator for the arguments `tol` and `method`, or raises ValueError.
    build_call : callable
        Returns, for an operator, the call that is timed.
    """
    for method, tol in product(methods, tolerances):
        row = replace(case, method=method, tol=tol)
        try:
            operator = plan(tol=tol, method=method)
        except ValueError as error:
            yield Candidate(row, partial(raise_refusal, error))
            continue
        row = replace(row, precision=operator.account.precision)
        yield Candidate(row, partial(_plan_call, operator, build_call))


def _plan_call(
    operator: Operator, build_call: Callable[[Operator], Callable[[], Any]]
) -> tuple[Callable[[], Any], float, int]:
    return build_call(operator), operator.account.error, operator.account.bytes


@dataclass
class MeasurementSet:
    """Measured rows with the front marked.

    `calls` holds the timed calls by the index of their row, `calibration_s` the processor time of
    the calibration kernel in seconds.
    """

    rows: list[Row]
    calls: dict[int, Callable[[], Any]]
    calibration_s: float


def measure(
    candidates: Sequence[Candidate], truth: np.ndarray, progress: Progress
) -> MeasurementSet:
    """Measure the error and time of each candidate of a work-precision diagram.

    A candidate that fails gives a row, too. Calls take turns, so that a busy moment of the machine
    affects all of them alike. `truth` is the exact answer.
    """
    rows: list[Row] = []
    calls: dict[int, Callable[[], Any]] = {}
    for number, candidate in enumerate(candidates):
        progress.report(0.5 * number / len(candidates), f"planning {candidate.row.method}")
        try:
            call, predicted, size = candidate.plan()
            value = np.asarray(call(), dtype=np.float64)
        except (ValueError, MemoryError) as error:
            rows.append(replace(candidate.row, failure=str(error)))
            continue
        achieved = float(np.linalg.norm(value - truth) / np.linalg.norm(truth))
        calls[len(rows)] = call
        rows.append(
            replace(
                candidate.row, error_achieved=achieved, error_predicted=predicted, peak_bytes=size
            )
        )
    times, calibration_s = time_calls(calls, progress.part(0.5, 1.0))
    for index, (cpu, wall) in times.items():
        rows[index] = replace(rows[index], cpu_s=cpu, wall_s=wall)
    return MeasurementSet(mark_front(rows), calls, calibration_s)


def time_calls(
    calls: Mapping[int, Callable[[], Any]], progress: Progress
) -> tuple[dict[int, tuple[float, float]], float]:
    """Return median processor and wall-clock seconds of each work-precision call, by its index.

    The second value is the median processor time of the calibration kernel in seconds.
    """
    jobs: dict[int, Callable[[], Any]] = {-1: CalibrationKernel(), **calls}
    times: dict[int, list[tuple[float, float]]] = {index: [] for index in jobs}
    repeats = _TIMING.repeats
    for repeat in range(repeats):
        progress.report(repeat / repeats, f"timing, {repeat + 1} of {repeats}")
        for index, call in jobs.items():
            times[index].append(_time_call(call))
    medians: dict[int, tuple[float, float]] = {}
    for index, measured in times.items():
        cpu, wall = (statistics.median(column) for column in zip(*measured, strict=True))
        medians[index] = (cpu, wall)
    return medians, medians.pop(-1)[0]


def _time_call(call: Callable[[], Any]) -> tuple[float, float]:
    """Return processor and wall-clock seconds of a call for a work-precision row.

    The call is repeated until it has used enough processor time. Both values are averages.
    """
    least_s = _TIMING.least_s
    count, cpu, wall = 0, time.process_time(), time.perf_counter()
    while True:
        call()
        count += 1
        spent = time.process_time() - cpu
        if spent >= least_s:
            return spent / count, (time.perf_counter() - wall) / count


R = TypeVar("R", bound=Row)


def mark_front(rows: Sequence[R]) -> list[R]:
    """Mark work-precision rows that no other row beats in both time and error; return all rows."""

    def is_dominated(row: R) -> bool:
        return any(
            _cpu_time(other) < _cpu_time(row) and _error(other) < _error(row) for other in rows
        )

    return [replace(row, on_front=not row.failure and not is_dominated(row)) for row in rows]


def _cpu_time(row: Row) -> float:
    return math.inf if row.cpu_s is None else row.cpu_s


def _error(row: Row) -> float:
    return math.inf if row.error_achieved is None else row.error_achieved
