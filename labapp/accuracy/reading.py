"""Reads measured rows in words: the cheapest setting, the next decimal, the failures."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from labapp.accuracy.work_precision import AUTOMATIC, CUT, Row
from labapp.common.stopwatch import format_short_time

WANTED = 1e-3
"""Error for which the cheapest setting is named; chosen: the default tolerance of a PSF."""

_NEAR_BEST = 1.1
"""Where no setting reaches it, the cheapest is named whose error is at most so many times the
least. Chosen."""

_SAME_TIME = 1.1
"""Times whose ratio is at most this count as the same: of such settings the automatic choice is the
cheapest, or else the one of the largest tolerance. Measured: the first answers of one setting
scatter by about a tenth."""

_GRID = re.compile(r"(\d+²) grid, ")
"""Grid size in the name of a method; it is the setting of a method without a tolerance."""

_PEER_SIZE = re.compile(r"\d+² ")
_COMMON_WORDS = ("pupil", "gray edge")
"""Words in the names of methods that curves leave out."""


@dataclass(frozen=True)
class TimeKind:
    """A time by which rows are compared, and the number of calls of its automatic choice."""

    name: str
    seconds: Callable[[Row], float | None]
    is_on_front: Callable[[Row], bool]
    calls: int

    @property
    def short_name(self) -> str:
        return self.name.partition(":")[0]


FIRST_ANSWER = TimeKind(
    "First answer: planning and one call",
    lambda row: row.first_answer_s,
    lambda row: row.on_first_front,
    1,
)
ONE_RUN = TimeKind("One run", lambda row: row.cpu_s, lambda row: row.on_front, 100)
EACH_CALL = TimeKind("Each further call", lambda row: row.cpu_s, lambda row: row.on_front, 100)


def time_kinds(rows: Sequence[Row]) -> list[TimeKind]:
    """Return the times that rows have: of iterative methods only that of a call."""
    first = any(row.first_answer_s is not None for row in rows)
    return [FIRST_ANSWER, EACH_CALL] if first else [ONE_RUN]


def curve_name(row: Row) -> str:
    """Return the name of the curve to which a row belongs: its method.

    If its setting is the size of a grid, this and common words are left out, and the precision is
    added.
    """
    if row.tol is not None or hasattr(row, "iterations"):
        return row.engine if row.method == AUTOMATIC else row.method
    words = [_PEER_SIZE.sub("", word) for word in row.method.split(", ")]
    words = [word for word in words if word not in _COMMON_WORDS]
    return ", ".join([*words, row.precision])


def setting_name(row: Row) -> str:
    """Return what was asked of a method: a tolerance, iterations, or a grid."""
    if row.tol is not None:
        return format_error(row.tol)
    if iterations := getattr(row, "iterations", 0):
        return f"{iterations} iterations" if iterations > 1 else "1 iteration"
    found = _GRID.search(row.method)
    return f"{found[1]} grid" if found else ""


def cheapest_row(rows: Sequence[Row], kind: TimeKind, wanted: float = WANTED) -> Row | None:
    """Return the row of least time whose measured error is at most `wanted`, or None.

    Of rows that take the same time but for scatter, the automatic choice for this very tolerance
    is preferred, then other automatic choices, then the quickest.
    """
    fitting = [
        (seconds, row)
        for row in rows
        if (seconds := kind.seconds(row)) is not None
        and row.error_achieved is not None
        and row.error_achieved <= wanted
    ]
    if not fitting:
        return None
    longest = _SAME_TIME * min(seconds for seconds, _ in fitting)

    def rank(one: tuple[float, Row]) -> tuple[bool, bool, float, float]:
        seconds, row = one
        chosen = kind.calls in row.chosen_for
        return not (chosen and row.tol == wanted), not chosen, -(row.tol or 0.0), seconds

    return min((one for one in fitting if one[0] <= longest), key=rank)[1]


def highlighted_row(rows: Sequence[Row], kind: TimeKind) -> Row | None:
    """Return the row of a diagram's star: the cheapest of the wanted error, or near the least."""
    found = cheapest_row(rows, kind)
    if found is not None:
        return found
    errors = [row.error_achieved for row in rows if row.error_achieved and kind.seconds(row)]
    return cheapest_row(rows, kind, _NEAR_BEST * min(errors)) if errors else None


def cheapest_sentence(rows: Sequence[Row], kind: TimeKind) -> str:
    """Say which setting is the cheapest for the wanted error, as a diagram's title."""
    row = highlighted_row(rows, kind)
    if row is None:
        return "Nothing was measured."
    wanted = format_error(WANTED)
    words = describe_setting(row, kind)
    if cheapest_row(rows, kind) is not None:
        return f"Cheapest for {wanted}: {words}"
    best = min(one.error_achieved or math.inf for one in rows)
    near = f"{100 * _NEAR_BEST - 100:.0f} %"
    return (
        f"None reaches {wanted} (best {format_error(best)}). Cheapest within {near} of it: {words}"
    )


def describe_setting(row: Row, kind: TimeKind) -> str:
    """Describe a row's setting and its time in a few words."""
    seconds = kind.seconds(row)
    setting = setting_name(row)
    asked = f", tol {setting}" if row.tol is not None else f", {setting}" if setting else ""
    return f"{curve_name(row)}{asked}, {format_seconds(seconds)}"


def choice_sentence(rows: Sequence[Row]) -> str:
    """Say what the automatic choice takes if the wanted error is asked for; empty without one."""
    for row in chosen_rows(rows, EACH_CALL):
        if row.tol == WANTED:
            first = format_seconds(row.first_answer_s)
            return (
                f"If you ask for {format_error(row.tol)}, {curve_name(row)} is chosen: {first} for "
                f"the first answer, {format_seconds(row.cpu_s)} for each further call."
            )
    return ""


def chosen_rows(rows: Sequence[Row], kind: TimeKind) -> list[Row]:
    """Return the rows of the automatic choice, from the largest tolerance to the least."""
    found = [row for row in rows if kind.calls in row.chosen_for and not row.failure]
    return sorted(found, key=lambda row: -(row.tol or 0))


def next_decimal_sentences(rows: Sequence[Row], kind: TimeKind) -> list[str]:
    """Say what each further decimal costs, by the automatic choice; nothing without tolerances.

    Decimals that cost next to nothing are joined.
    """
    chosen = [row for row in chosen_rows(rows, kind) if row.tol is not None and kind.seconds(row)]
    steps, same = list[tuple[float, float, str]](), "about the same time"
    for before, after in pairwise(chosen):
        ratio = (kind.seconds(after) or 0) / (kind.seconds(before) or 1)
        is_same = 1 / _SAME_TIME <= ratio <= _SAME_TIME
        words = same if is_same else f"{ratio:.2g} times the time"
        if steps and words == steps[-1][2] == same:
            steps[-1] = (steps[-1][0], after.tol or 0, same)
        else:
            steps.append((before.tol or 0, after.tol or 0, words))
    return [f"from {format_error(a)} to {format_error(b)}: {words}" for a, b, words in steps]


def failure_sentences(rows: Sequence[Row]) -> list[str]:
    """Say for each reason which methods refuse; reasons that differ only in numbers are one."""
    reasons: dict[str, list[Row]] = {}
    for row in rows:
        if row.failure:
            reasons.setdefault(re.sub(r"\d[\d.e+-]*", "#", row.failure), []).append(row)
    return [_failure_sentence(found) for found in reasons.values()]


def _failure_sentence(rows: list[Row]) -> str:
    *most, last = dict.fromkeys(curve_name(row) for row in rows)
    names = f"{', '.join(most)} and {last}" if most else last
    if rows[0].failure == CUT:
        return f"{names} {'are' if most else 'is'} {CUT}{_settings_of(rows)}."
    verb = "give no answer" if most else "gives no answer"
    # The tolerance that could be kept is named by the first refusal, the largest tolerance.
    return f"{names} {verb}{_settings_of(rows)}: {rows[0].failure}."


def _settings_of(rows: list[Row]) -> str:
    """Name the tolerances of rows that fail for one reason; "" if they have none."""
    tolerances = [row.tol for row in rows if row.tol is not None]
    if not tolerances:
        return ""
    first, last = format_error(max(tolerances)), format_error(min(tolerances))
    return f" (tol {first})" if first == last else f" (tol {first} to {last})"


def curves(rows: Sequence[Row], kind: TimeKind) -> Iterator[tuple[str, list[Row]]]:
    """Yield each curve's name, and its rows in the order of what was asked."""
    good = [row for row in rows if row.error_achieved is not None and kind.seconds(row)]
    for name in dict.fromkeys(curve_name(row) for row in good):
        own = [row for row in good if curve_name(row) == name]
        yield name, sorted(own, key=lambda row: -(row.tol or 0))


def format_error(value: float) -> str:
    """Format an error or a tolerance: 1e-3, 2.5e-4, 0.12."""
    if value == 0 or value > 0.1:
        return f"{value:.3g}" if value >= 100 else f"{value:.2g}"
    digits, power = f"{value:.1e}".split("e")
    return f"{digits.removesuffix('.0')}e{int(power)}"


def format_seconds(seconds: float | None) -> str:
    """Format a time with two digits: 0.12 ms, 3.4 ms; "" for None."""
    return "" if seconds is None else format_short_time(seconds)


def format_bytes(count: int | None) -> str:
    """Format a size in memory in megabytes; "" for None."""
    return (
        "" if count is None else f"{count / 1e6:.2g} MB" if count < 1e8 else f"{count / 1e6:.0f} MB"
    )
