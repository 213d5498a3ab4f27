"""Writes one HTML file with diagrams as inline SVG, and nothing to load."""

from __future__ import annotations

import io
import re
from html import escape

import matplotlib
from matplotlib.figure import Figure

from labapp.accuracy.diagram import draw_panels
from labapp.accuracy.overview.measured import MeasuredOperation, Outcome
from labapp.accuracy.reading import (
    choice_sentence,
    curve_name,
    failure_sentences,
    format_bytes,
    format_error,
    format_seconds,
    next_decimal_sentences,
    setting_name,
)
from labapp.accuracy.work_precision import Row
from labapp.common.figure_png import show_plain_text
from labapp.pictures.report.html import document, footer, html_table

_STYLE = """<style>
:root { color-scheme: light }
body { background: #fff; color: #1b1b1b; max-width: 80rem }
nav a { margin-right: 1rem; white-space: nowrap }
svg { width: 100%; height: auto; display: block }
section { break-before: page; margin-top: 2.5rem }
.cheapest { color: #c1121f; font-weight: 600; margin: .2rem 0 }
.case { color: #555; margin-top: 0 }
table { font-size: .9rem } td:not(:last-child) { white-space: nowrap }
td:last-child { min-width: 11rem }
details { margin: .6rem 0 } h2 { margin-bottom: .2rem }
@media print { nav, details { display: none } table, svg { break-inside: avoid } }
</style>"""

_INTRODUCTION = """<p>Every computation of labapp that has one right answer takes a tolerance: the
relative error that you accept. This page shows what it costs on this machine. Each point of a
diagram is one setting of one method: further left is faster, further down is more exact. A first
answer takes planning and one call; a further call takes the plan that is there. The small diagrams
show each method alone; the tolerance that was asked for, or the number of iterations, is written
beside its points. The <b style="color:#c1121f">red star</b> is the cheapest setting whose measured
error is at most 1e-3 in this case, and the diagram's title names it. A larger tolerance that
happens to reach 1e-3 here may not reach it elsewhere: only a tolerance of 1e-3 promises it.
<b>Rings</b> are what labapp chooses by itself if you name only a tolerance, which is the bar above
the ring. The <b>dark line</b> is the front: nothing measured is both faster and more exact than it.
Phase retrieval and restoration have no right answer; they take iterations instead of a tolerance.
Times are processor time on one thread; times that differ by less than a tenth count as the
same.</p>"""

_ALL_COLUMNS = (
    "method", "asked ", "reached ", "predicted error ", "first answer ", "predicted first ",
    "each call ", "predicted call ", "memory ", "remark",
)  # fmt: skip


def page_html(outcome: Outcome) -> str:
    """Return all measured operations as an HTML page."""
    title = "What accuracy costs"
    links = " ".join(f'<a href="#{one.name}">{escape(one.title)}</a>' for one in outcome.operations)
    summary = [row for one in outcome.operations for row in one.summary_rows]
    parts = [
        _STYLE,
        f"<h1>{title}</h1>",
        f'<p class="case">{escape(outcome.machine)}. {escape(outcome.scope)}. Measured in '
        f"{outcome.seconds / 60:.1f} minutes.</p>",
        _warning(outcome),
        _INTRODUCTION,
        f"<nav>{links}</nav>",
        "<h2>At a glance</h2>" + html_table(["operation", "time of", "setting"], summary),
        *(_section(one) for one in outcome.operations),
        footer(),
    ]
    return document(title, parts)


def _warning(outcome: Outcome) -> str:
    """Name what wasn't measured, and why."""
    lines = [f"<li>{escape(one.title)}: {escape(one.why)}.</li>" for one in outcome.left_out]
    cancelled = "<p><b>Measuring was cancelled.</b></p>" if outcome.cancelled else ""
    if not lines:
        return cancelled
    return f"{cancelled}<p>Not measured:</p><ul>{''.join(lines)}</ul>"


def _section(one: MeasuredOperation) -> str:
    cheapest = "".join(
        f'<p class="cheapest">★ {escape(time)}: {escape(sentence[:1].lower() + sentence[1:])}.</p>'
        for _, time, sentence in one.summary_rows
    )
    return (
        f'<section id="{one.name}"><h2>{escape(one.title)}</h2>'
        f'<p class="case">{escape(one.case)}</p><p>{escape(one.what)}</p>{cheapest}'
        f"<p>{escape(choice_sentence(one.rows))}</p>"
        f"<figure>{inline_svg(draw_panels(one.rows, one.error_name), one.name)}</figure>"
        f"{_next_decimals(one)}{_failures(one)}"
        f"{_table(one)}{_all_rows(one)}</section>"
    )


def _next_decimals(one: MeasuredOperation) -> str:
    """Say what each further decimal costs."""
    lines = [
        f"<li>{escape(kind.short_name)}: {escape('; '.join(said))}.</li>"
        for kind in one.kinds
        if (said := next_decimal_sentences(one.rows, kind))
    ]
    if not lines:
        return (
            "<p><b>What the next decimal costs:</b> it can't be bought here; the error levels off "
            "where the diagram's front ends.</p>"
        )
    return (
        f"<p><b>What the next decimal costs</b>, chosen automatically:</p><ul>{''.join(lines)}</ul>"
    )


def _failures(one: MeasuredOperation) -> str:
    said = failure_sentences(one.rows)
    lines = "".join(f"<li>{escape(line[:1].upper() + line[1:])}</li>" for line in said)
    return f"<p><b>What isn't in the diagram:</b></p><ul>{lines}</ul>" if said else ""


def _table(one: MeasuredOperation) -> str:
    """Return the automatic choices and the cheapest, without columns that would be empty."""
    rows = [_cells(one, row) for row in one.table_rows]
    kept = [k for k in range(len(_ALL_COLUMNS)) if not rows or any(cells[k] for cells in rows)]
    return html_table([_ALL_COLUMNS[k] for k in kept], [[cells[k] for k in kept] for cells in rows])


def _cells(one: MeasuredOperation, row: Row) -> list[str]:
    """Return a row of the table as text."""
    return [
        curve_name(row),
        setting_name(row),
        (row.failure and "–") or _error(row.error_achieved),
        _error(row.error_predicted),
        format_seconds(row.first_answer_s),
        format_seconds(row.first_answer_predicted_s),
        format_seconds(row.cpu_s),
        format_seconds(row.cpu_predicted_s),
        format_bytes(row.peak_bytes),
        one.marks(row),
    ]


def _error(value: float | None) -> str:
    return "" if value is None else format_error(value)


def _all_rows(one: MeasuredOperation) -> str:
    """Return all rows of an operation, folded away."""
    good = [row for row in one.rows if not row.failure]
    rows = [_cells(one, row) for row in good]
    table = html_table(_ALL_COLUMNS, rows)
    return (
        f"<details><summary>All {len(good)} settings that were measured</summary>{table}</details>"
    )


def inline_svg(figure: Figure, name: str) -> str:
    """Return a diagram as SVG inside HTML; `name` makes its ids unique."""
    buffer = io.StringIO()
    show_plain_text(figure)
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    drawn = buffer.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.DOTALL)
    drawn = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", drawn, count=1)
    drawn = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", drawn, count=1)
    return re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{name}-", drawn)
