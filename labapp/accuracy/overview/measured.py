"""What was measured, in marks, rows and plain data for the page and its JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import labapp
from labapp.accuracy.reading import (
    WANTED,
    TimeKind,
    cheapest_row,
    cheapest_sentence,
    failure_sentences,
    format_error,
    highlighted_row,
    next_decimal_sentences,
    setting_name,
    time_kinds,
)
from labapp.accuracy.row_output import row_data
from labapp.accuracy.work_precision import CUT, Row


@dataclass(frozen=True)
class MeasuredOperation:
    """What was measured of one operation, in words and rows.

    what: what is computed and how the diagram is read.
    seconds: wall-clock time that measuring took.
    """

    name: str
    title: str
    what: str
    case: str
    error_name: str
    rows: Sequence[Row]
    seconds: float

    @property
    def kinds(self) -> list[TimeKind]:
        return time_kinds(self.rows)

    @property
    def table_rows(self) -> list[Row]:
        """The rows of the page's table: automatic choices, and the cheapest.

        Without tolerances, the rows on the front are in the table as well.
        """
        asked = any(row.tol is not None for row in self.rows)
        starred = [highlighted_row(self.rows, kind) for kind in self.kinds]
        found = [
            row
            for row in self.rows
            if not row.failure
            and (
                row.chosen_for or any(row is one for one in starred) or (row.on_front and not asked)
            )
        ]
        if asked:
            return sorted(found, key=lambda row: -(row.tol or 0))
        return sorted(found, key=lambda row: row.cpu_s or 0)

    def marks(self, row: Row) -> str:
        """Return a row's marks in words: the cheapest, and automatic choices."""
        starred = [kind for kind in self.kinds if highlighted_row(self.rows, kind) is row]
        words = []
        if starred:
            reached = cheapest_row(self.rows, starred[0]) is not None
            goal = f"for {format_error(WANTED)}" if reached else "near the best"
            times = " and ".join(kind.short_name.lower() for kind in starred)
            words.append(f"★ cheapest {goal}, {times}")
        if row.tol is None:
            words += ["automatic choice"] if row.chosen_for else []
        elif row.chosen_for:
            counts = " or ".join(str(count) for count in row.chosen_for)
            words.append(f"automatic choice for {counts} call{'' if counts == '1' else 's'}")
        return "; ".join(words)

    def as_data(self) -> dict[str, Any]:
        """Return what the page shows of the operation, and all rows, as plain data."""
        return {
            "name": self.name,
            "title": self.title,
            "what": self.what,
            "case": self.case,
            "error": self.error_name,
            "seconds": self.seconds,
            "cheapest": {
                kind.name: {
                    "row": None if star is None else self.rows.index(star),
                    "reaches": WANTED if cheapest_row(self.rows, kind) is not None else None,
                    "words": cheapest_sentence(self.rows, kind),
                }
                for kind in self.kinds
                for star in [highlighted_row(self.rows, kind)]
            },
            "next_decimal": {
                kind.name: next_decimal_sentences(self.rows, kind) for kind in self.kinds
            },
            "failures": failure_sentences(self.rows),
            "cut": [
                f"{row.method}, {setting_name(row)}" for row in self.rows if row.failure == CUT
            ],
            "table": [self.rows.index(row) for row in self.table_rows],
            "rows": [row_data(row) for row in self.rows],
        }

    @property
    def summary_rows(self) -> list[list[str]]:
        """The cheapest setting for each kind of time: title, time, sentence."""
        return [
            [self.title, kind.short_name, cheapest_sentence(self.rows, kind)] for kind in self.kinds
        ]


@dataclass(frozen=True)
class LeftOut:
    """An operation that wasn't measured, and why."""

    name: str
    title: str
    why: str


@dataclass(frozen=True)
class Outcome:
    """All that was measured.

    machine, scope: the machine, and the camera that was measured, in words.
    left_out: operations that weren't measured.
    seconds: wall-clock time of the whole.
    cancelled: whether a person stopped it.
    """

    machine: str
    scope: str
    operations: Sequence[MeasuredOperation]
    left_out: Sequence[LeftOut]
    seconds: float
    cancelled: bool

    def as_data(self) -> dict[str, Any]:
        """Return everything as plain data for JSON."""
        return {
            "version": labapp.__version__,
            "machine": self.machine,
            "scope": self.scope,
            "seconds": self.seconds,
            "cancelled": self.cancelled,
            "left_out": [vars(one) for one in self.left_out],
            "operations": [one.as_data() for one in self.operations],
        }
