"""One measured point of a work-precision diagram, and which points are worth having."""

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

_REPEATS = 5
_LEAST_SECONDS = 0.02
"""Processor time that a measurement adds up to, at least, so that the clock's steps vanish."""


@dataclass(frozen=True)
class Row:
    """A method at one setting: what was asked, achieved and paid.

    tol: None for methods that take none. error_*: relative L2. cpu_s, wall_s: of one call,
    planning left out. peak_bytes: of the largest arrays, as the method accounts for them.
    on_front: whether no other row is both faster and more accurate. failure: why it gave
    nothing, else empty.
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
    """A row to be measured: `plan()` gives the call, its predicted error and its bytes."""

    row: Row
    plan: Callable[[], tuple[Callable[[], Any], float | None, int]]


def raise_refusal(error: Exception) -> tuple[Callable[[], Any], float | None, int]:
    """Plan what can't be had: a row whose failure is the error's words."""
    raise error


def candidates_by_tolerance(
    case: Row,
    methods: Iterable[str],
    tolerances: Iterable[float],
    plan: Callable[..., Operator],
    build_call: Callable[[Operator], Callable[[], Any]],
) -> Iterator[Candidate]:
    """Every method at every tolerance; what refuses is a row that says why.

    case: a row that names it. plan: an operator for `tol` and `method`, or ValueError. build_call:
    the call whose time counts.
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
    """Rows with the front marked, the calls behind them, and the calibration kernel's time."""

    rows: list[Row]
    calls: dict[int, Callable[[], Any]]
    calibration_s: float


def measure(
    candidates: Sequence[Candidate], truth: np.ndarray, progress: Progress
) -> MeasurementSet:
    """Every candidate, failures included.

    Calls are interleaved, so that a busy moment of the machine hits all of them alike.
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
    """Processor and wall-clock seconds of each call, and of the calibration kernel: medians."""
    jobs: dict[int, Callable[[], Any]] = {-1: CalibrationKernel(), **calls}
    times: dict[int, list[tuple[float, float]]] = {index: [] for index in jobs}
    for repeat in range(_REPEATS):
        progress.report(repeat / _REPEATS, f"timing, {repeat + 1} of {_REPEATS}")
        for index, call in jobs.items():
            times[index].append(_time_call(call))
    medians: dict[int, tuple[float, float]] = {}
    for index, measured in times.items():
        cpu, wall = (statistics.median(column) for column in zip(*measured, strict=True))
        medians[index] = (cpu, wall)
    return medians, medians.pop(-1)[0]


def _time_call(call: Callable[[], Any]) -> tuple[float, float]:
    """Processor and wall-clock seconds of one call."""
    count, cpu, wall = 0, time.process_time(), time.perf_counter()
    while True:
        call()
        count += 1
        spent = time.process_time() - cpu
        if spent >= _LEAST_SECONDS:
            return spent / count, (time.perf_counter() - wall) / count


R = TypeVar("R", bound=Row)


def mark_front(rows: Sequence[R]) -> list[R]:
    """The rows with those marked that no other beats in both time and error."""

    def is_dominated(row: R) -> bool:
        return any(
            _cpu_time(other) < _cpu_time(row) and _error(other) < _error(row) for other in rows
        )

    return [replace(row, on_front=not row.failure and not is_dominated(row)) for row in rows]


def _cpu_time(row: Row) -> float:
    return math.inf if row.cpu_s is None else row.cpu_s


def _error(row: Row) -> float:
    return math.inf if row.error_achieved is None else row.error_achieved
