"""Measures the points of a work-precision diagram, and marks those on its front."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple, TypeVar

import numpy as np
import scipy.fft

from optics.accuracy import Account
from optics.progress import Progress
from optics.propagation.free_space_operator import FreeSpace
from optics.psf import PSFOperator

LONGEST_CALL = 600.0
"""Processor seconds that a method may take, which is there to be measured; whole panels take
minutes. Chosen."""

Operator = TypeVar("Operator", PSFOperator, FreeSpace)


_REPEATS = 5
"""Measurements of each call, of which the median counts; chosen."""

_LEAST_S = 0.02
"""Processor seconds of a measurement, to which short calls add up; chosen so that the steps of the
clock don't matter."""

_FIRST_ANSWERS_S = 0.15
"""Processor seconds up to which first answers are repeated, as often as calls at most: single ones
of some milliseconds scatter by a factor of two. Chosen."""

_LOOSE = 5e-3
"""Tolerances above it are used to warm up; chosen, because strict ones may take long."""


@dataclass(frozen=True)
class Row:
    """Measured error and time of a method at one setting.

    operation, case, method, precision: what was computed, for which case, how, and in which number
    format.
    tol: requested tolerance; None for methods that take none.
    error_achieved, error_predicted: relative L2 error.
    cpu_s, wall_s: processor and wall-clock seconds of one call, without planning.
    peak_bytes: size of the largest arrays, as the method accounts for them.
    on_front: whether no other row is both more accurate and faster per call.
    failure: why the method gave no result; empty if it gave one.
    engine: what the method's account calls it.
    first_answer_s: processor seconds of planning and the first call; of short ones, the median of
    several.
    cpu_predicted_s, first_answer_predicted_s: predictions of `cpu_s` and `first_answer_s`.
    on_first_front: whether no other row is both more accurate and faster to its first answer.
    chosen_for: numbers of calls for which the automatic choice is this row; () if there are none.
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
    engine: str = ""
    first_answer_s: float | None = None
    cpu_predicted_s: float | None = None
    first_answer_predicted_s: float | None = None
    on_first_front: bool = False
    chosen_for: tuple[int, ...] = ()


@dataclass(frozen=True)
class PlannedCall:
    """A method that is ready to be measured: its call, and the bytes of its largest arrays.

    account: tells afterwards what the method says of its error and time, if it says anything.
    """

    call: Callable[[], Any]
    bytes: int
    account: Callable[[], Account] | None = None


@dataclass(frozen=True)
class Candidate:
    """A row to be measured.

    plan: makes the call ready, and raises ValueError if it can't.
    calls: that the automatic choice is made for, which is measured only if no row of a named method
    is the same; 0 for a named method.
    """

    row: Row
    plan: Callable[[], PlannedCall]
    calls: int = 0


def raise_refusal(error: Exception) -> PlannedCall:
    """Raise the error of an earlier planning, so that its message becomes the row's failure."""
    raise error


class Comparison(NamedTuple):
    """What `measure` takes of a case: its candidates, the exact answer, and a similar case's."""

    candidates: list[Candidate]
    truth: np.ndarray
    warm_up: Iterable[Candidate]


AUTOMATIC = "automatic choice"
"""Method of a row that the automatic choice has and no named method."""

CALLS = (1, 100)
"""Numbers of calls for which the automatic choice is marked: a function's, and an operator's."""


def candidates_by_tolerance(
    case: Row,
    methods: Iterable[str],
    tolerances: Sequence[float],
    plan: Callable[..., Operator],
    build_call: Callable[[Operator], Callable[[], Any]],
) -> Iterator[Candidate]:
    """Yield every method at every tolerance, and then the automatic choices.

    case: row that names operation and case.
    plan: returns an operator for the arguments `tol`, `method` and `calls`, or raises ValueError.
    Without a method, the choice is automatic.
    build_call: returns, for an operator, the call that is timed.
    """

    def plan_call(tol: float, method: str | None, calls: int) -> PlannedCall:
        operator = plan(tol=tol, method=method, calls=calls)
        size = operator.account.bytes
        return PlannedCall(build_call(operator), size, lambda: operator.account)

    for method, tol in product(methods, tolerances):
        row = replace(case, method=method, tol=tol)
        yield Candidate(row, partial(plan_call, tol, method, CALLS[-1]))
    for calls, tol in product(CALLS, tolerances):
        row = replace(case, method=AUTOMATIC, tol=tol)
        yield Candidate(row, partial(plan_call, tol, None, calls), calls)


def similar_wavelength(wavelength: float) -> float:
    """Return a nearby wavelength: methods do the same for it, but nothing kept serves both."""
    return wavelength * (1 + 1e-4)


@dataclass
class MeasurementSet:
    """Measured rows with the front marked, and their timed calls by the index of the row.

    calibration_s: processor seconds of the calibration kernel.
    """

    rows: list[Row]
    calls: dict[int, Callable[[], Any]]
    calibration_s: float


@dataclass(frozen=True)
class Deadline:
    """The time by which measuring ends, by `time.monotonic()`: whatever is left is cut."""

    until: float = math.inf

    @staticmethod
    def after(seconds: float) -> Deadline:
        """Return the deadline of work that may take so many seconds from now."""
        return Deadline(time.monotonic() + seconds)

    @property
    def is_over(self) -> bool:
        return time.monotonic() >= self.until

    def share(self, part: float) -> Deadline:
        """Return the deadline after a share of the time that is left."""
        if math.isinf(self.until):
            return self
        now = time.monotonic()
        return Deadline(now + part * (self.until - now))


ENDLESS = Deadline()

CUT = "not measured: the time for this operation was used up"
"""Failure of a row that was cut."""


def measure(
    candidates: Sequence[Candidate],
    truth: np.ndarray,
    progress: Progress,
    *,
    warm_up: Iterable[Candidate] = (),
    deadline: Deadline = ENDLESS,
) -> MeasurementSet:
    """Measure error and time of each candidate; one that fails gives a row, too.

    Calls take turns, so that a busy moment of the machine affects all of them alike. Automatic
    choices mark the row of the method that they chose, or are measured if there is none.
    truth: the exact answer.
    warm_up: of a similar case, for which nothing is cached. Those of loose tolerances are computed
    beforehand: what a library does at its first use in a process is in no row's time.
    deadline: when measuring ends; rows that are left then are named as cut.
    """
    for candidate in warm_up:
        if candidate.row.tol is None or candidate.row.tol <= _LOOSE:
            continue
        with suppress(ValueError, MemoryError):
            candidate.plan().call()
    rows, calls = _answer_once(candidates, truth, progress.part(0.0, 0.5), deadline.share(0.6))
    times, calibration_s = time_calls(calls, progress.part(0.5, 1.0), deadline)
    for index, (cpu, wall) in times.items():
        rows[index] = replace(rows[index], cpu_s=cpu, wall_s=wall)
    return MeasurementSet(mark_front(rows), calls, calibration_s)


def _answer_once(
    candidates: Sequence[Candidate], truth: np.ndarray, progress: Progress, deadline: Deadline
) -> tuple[list[Row], dict[int, Callable[[], Any]]]:
    """Return rows with error and time of each candidate's first answer, and the calls to time."""
    rows, calls = list[Row](), dict[int, Callable[[], Any]]()
    for number, candidate in enumerate(candidates):
        progress.report(number / len(candidates), f"planning {candidate.row.method}")
        if deadline.is_over:
            rows += [] if candidate.calls else [replace(candidate.row, failure=CUT)]
            continue
        began = time.process_time()
        try:
            planned = candidate.plan()
            row = _describe_planned(candidate.row, planned)
            if candidate.calls and mark_chosen(rows, row, candidate.calls):
                continue
            value = np.asarray(planned.call(), dtype=np.float64)
        except (ValueError, MemoryError) as error:
            # If nothing can be chosen, the named methods have said why.
            rows += [] if candidate.calls else [replace(candidate.row, failure=str(error))]
            continue
        spent = _first_answer_seconds(candidate, time.process_time() - began, deadline)
        calls[len(rows)] = planned.call
        rows.append(
            replace(
                _describe_planned(row, planned),
                error_achieved=relative_error(value, truth),
                first_answer_s=spent,
                chosen_for=(candidate.calls,) if candidate.calls else (),
            )
        )
    return rows, calls


def relative_error(value: Any, truth: np.ndarray) -> float:
    """Return an answer's relative L2 error."""
    return float(np.linalg.norm(value - truth) / np.linalg.norm(truth))


def _first_answer_seconds(candidate: Candidate, first: float, deadline: Deadline) -> float:
    """Return the median processor seconds of a candidate's first answers.

    first: seconds of the one that was computed already. Each is planned anew.
    """
    found = [first]
    while len(found) < _REPEATS and sum(found) < _FIRST_ANSWERS_S and not deadline.is_over:
        began = time.process_time()
        candidate.plan().call()
        found.append(time.process_time() - began)
    return statistics.median(found)


def _describe_planned(row: Row, planned: PlannedCall) -> Row:
    """Return a row with what a planned method says of itself now."""
    row = replace(row, peak_bytes=planned.bytes)
    return row if planned.account is None else with_account(row, planned.account())


def with_account(row: Row, account: Account) -> Row:
    """Return a row with what a method's account predicts."""
    return replace(
        row,
        engine=account.method,
        precision=account.precision,
        error_predicted=account.error,
        cpu_predicted_s=account.cpu_predicted,
        first_answer_predicted_s=account.first_answer_predicted,
    )


def mark_chosen(rows: list[Row], choice: Row, calls: int) -> bool:
    """Mark the row that the automatic choice is the same as; tell whether there is one."""
    for number, row in enumerate(rows):
        if not row.failure and (row.engine, row.tol) == (choice.engine, choice.tol):
            rows[number] = replace(row, chosen_for=(*row.chosen_for, calls))
            return True
    return False


def time_calls(
    calls: Mapping[int, Callable[[], Any]], progress: Progress, deadline: Deadline = ENDLESS
) -> tuple[dict[int, tuple[float, float]], float]:
    """Return median processor and wall-clock seconds of each call, and those of the kernel.

    The kernel's are processor seconds. Each call is timed once, and no more after the deadline.
    """
    jobs: dict[int, Callable[[], Any]] = {-1: _calibration_kernel(), **calls}
    times: dict[int, list[tuple[float, float]]] = {index: [] for index in jobs}
    for repeat in range(_REPEATS):
        for number, (index, call) in enumerate(jobs.items()):
            done = (repeat + number / len(jobs)) / _REPEATS
            progress.report(done, f"timing, {repeat + 1} of {_REPEATS}")
            if not (repeat and deadline.is_over):
                times[index].append(_time_call(call))
    medians: dict[int, tuple[float, float]] = {}
    for index, measured in times.items():
        cpu, wall = (statistics.median(column) for column in zip(*measured, strict=True))
        medians[index] = (cpu, wall)
    return medians, medians.pop(-1)[0]


def _calibration_kernel() -> Callable[[], Any]:
    """Return fixed work of about 10 ms: what the methods consist of, to tell the machine's speed.

    Times of different days or machines are compared as multiples of its time.
    """
    rng, side = np.random.default_rng(0), 512
    real, imaginary = rng.normal(size=(side, side)), rng.normal(size=(side, side))
    matrix = (real + 1j * imaginary).astype(np.complex64)
    values, places = rng.normal(size=side**2), rng.integers(0, side**2, side**2)
    return lambda: (matrix @ matrix, scipy.fft.fft2(matrix), values[places].sum())


def _time_call(call: Callable[[], Any]) -> tuple[float, float]:
    """Return average processor and wall-clock seconds of a call, which is repeated if short."""
    count, cpu, wall = 0, time.process_time(), time.perf_counter()
    while True:
        call()
        count += 1
        spent = time.process_time() - cpu
        if spent >= _LEAST_S:
            return spent / count, (time.perf_counter() - wall) / count


R = TypeVar("R", bound=Row)


def mark_front(rows: Sequence[R]) -> list[R]:
    """Mark the rows that no other row beats in both time and error; return all rows.

    There are two fronts, by the time of a call and by the time of the first answer.
    """

    def front(times: Sequence[float | None]) -> list[bool]:
        points = [
            tuple(math.inf if one is None else one for one in (seconds, row.error_achieved))
            for row, seconds in zip(rows, times, strict=True)
        ]
        return [
            not (row.failure or math.isinf(s) or any(t < s and e < error for t, e in points))
            for row, (s, error) in zip(rows, points, strict=True)
        ]

    per_call = front([row.cpu_s for row in rows])
    first = front([row.first_answer_s for row in rows])
    return [
        replace(row, on_front=on, on_first_front=on_first)
        for row, on, on_first in zip(rows, per_call, first, strict=True)
    ]
