"""Draws work-precision diagrams: error against time, with the front and the automatic choice."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from itertools import chain, cycle
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from labapp.accuracy.reading import (
    WANTED,
    TimeKind,
    cheapest_row,
    cheapest_sentence,
    chosen_rows,
    curve_name,
    curves,
    failure_sentences,
    format_error,
    format_seconds,
    highlighted_row,
    setting_name,
    time_kinds,
)
from labapp.accuracy.row_output import describe_machine
from labapp.accuracy.work_precision import Row

# All values of a diagram are chosen.
_WIDTH = 12.0
"""Inches of a diagram."""

_MAIN_HEIGHT, _SMALL_HEIGHT = 4.6, 2.0
"""Inches of the row of diagrams of all methods, and of a row of small ones."""

_COLUMNS = 4
"""Small diagrams in a row."""

_FLOOR = 1e-16
"""Errors below it are drawn at it: they are rounding."""

_NEAR = 0.2
"""Decades within which neighbouring points of a method share one label."""

_APART = 0.12
"""Least height between two labels, over the height of a small diagram."""

_TITLE_LETTERS = 112
"""Letters of titles that fit beside each other."""

_COLOURS = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c564b", "#7a5fb5",
    "#b5bd00", "#006d77", "#a63d40", "#5c6b73", "#c77dff", "#2d6a4f", "#e07a5f", "#3a0ca3",
)  # fmt: skip
_MARKERS = "osD^vP<>Xphd8*"
_FRONT, _STAR, _GREY = "#444444", "#c1121f", "#c9c9c9"


class _Look(NamedTuple):
    """Colours and markers of the methods, by name."""

    colour: dict[str, str]
    marker: dict[str, str]


def draw(name: str, rows: Sequence[Row], error_name: str = "error, relative L2") -> Figure:
    """Draw a diagram with a heading, and the failures in a sentence each under it."""
    lines = footing_lines(rows)
    figure = draw_panels(rows, error_name, heading=0.4, footing=0.35 + 0.19 * (len(lines) - 1))
    height = figure.get_figheight()
    # The legend stands above the room that is left for the heading.
    figure.text(0.01, 1 - 0.38 / height, textwrap.shorten(name, 150), va="top", fontsize=10)
    figure.text(0.01, 0.06 / height, "\n".join(lines), va="bottom", fontsize=8, color="#444444")
    return figure


def footing_lines(rows: Sequence[Row]) -> list[str]:
    """Return the lines under a diagram: failures in a sentence each, and the machine."""
    failures = [textwrap.wrap(one, 150, max_lines=2) for one in failure_sentences(rows)]
    return [*chain.from_iterable(failures), f"{describe_machine()}. Processor time, one thread."]


def draw_panels(
    rows: Sequence[Row], error_name: str, heading: float = 0.0, footing: float = 0.0
) -> Figure:
    """Draw all methods together for each kind of time, and then each method alone.

    heading, footing: inches that are left free above and below.
    """
    kinds = time_kinds(rows)
    names = [name for name, _ in curves(rows, kinds[-1])]
    lines = math.ceil(len(names) / _COLUMNS) if len(names) > 1 else 0
    heights = [_MAIN_HEIGHT, *[_SMALL_HEIGHT] * lines]
    total = sum(heights) + heading + footing
    room = (0, footing / total, 1, 1 - (footing + heading) / total)
    layout = ConstrainedLayoutEngine(rect=room)
    figure = Figure(figsize=(_WIDTH, total), dpi=100, layout=layout)
    grid = figure.add_gridspec(len(heights), 2 * _COLUMNS, height_ratios=heights)
    shown: tuple[list[Any], list[str]] = [], []
    look = _Look(dict(zip(names, cycle(_COLOURS))), dict(zip(names, cycle(_MARKERS))))
    width = 2 * _COLUMNS // len(kinds)
    for number, kind in enumerate(kinds):
        axes = figure.add_subplot(grid[0, number * width : (number + 1) * width])
        _draw_all(axes, rows, kind, look, error_name)
        if number == 0:
            shown = axes.get_legend_handles_labels()
    # The small diagrams name the methods; the legend has the marks.
    own = [pair for pair in zip(*shown, strict=True) if not (lines and pair[1] in look.colour)]
    if own:
        figure.legend(*zip(*own, strict=True), loc="outside upper left", ncols=6, fontsize=8.5)
    for number, name in enumerate(names if lines else []):
        row, column = divmod(number, _COLUMNS)
        axes = figure.add_subplot(grid[1 + row, 2 * column : 2 * column + 2])
        _draw_one(axes, rows, kinds[-1], look, name)
    return figure


def _draw_all(
    axes: Axes, rows: Sequence[Row], kind: TimeKind, look: _Look, error_name: str
) -> None:
    """Draw the errors of all methods against one kind of time."""
    for name, own in curves(rows, kind):
        colour, marker = look.colour[name], look.marker[name]
        axes.plot(*_points(own, kind), marker, ms=5, color=colour, label=name, alpha=0.85)
    _set_scales(axes, rows, kind)
    _draw_front(axes, rows, kind)
    _draw_choice(axes, rows, kind, look)
    _draw_star(axes, rows, kind)
    axes.set_xlabel(f"{kind.name}, processor time")
    axes.set_ylabel(f"measured {error_name}")
    width = round(_TITLE_LETTERS / len(time_kinds(rows)))
    title = "\n".join(textwrap.wrap(cheapest_sentence(rows, kind), width))
    axes.set_title(f"★ {title}", fontsize=10, fontweight="bold", color=_STAR, loc="left")


def _points(rows: Sequence[Row], kind: TimeKind) -> tuple[list[float], list[float]]:
    """Return the seconds and errors at which rows are drawn."""
    seconds = [kind.seconds(row) or 0.0 for row in rows]
    return seconds, [max(row.error_achieved or 0.0, _FLOOR) for row in rows]


def _draw_front(axes: Axes, rows: Sequence[Row], kind: TimeKind) -> None:
    front = sorted(zip(*_points([row for row in rows if kind.is_on_front(row)], kind), strict=True))
    if not front:
        return
    seconds, errors = (list(values) for values in zip(*front, strict=True))
    axes.step(
        [*seconds, axes.get_xlim()[1]], np.minimum.accumulate([*errors, errors[-1]]), where="post",
        color=_FRONT, lw=1.4, zorder=1, label="front: nothing is faster and better",
    )  # fmt: skip


def _draw_choice(axes: Axes, rows: Sequence[Row], kind: TimeKind, look: _Look) -> None:
    """Ring the automatic choice at each tolerance, with a line up to what was asked of it."""
    chosen = chosen_rows(rows, kind)
    if not chosen:
        return
    seconds, errors = _points(chosen, kind)
    # Where several methods lie in one place, the chosen one is on top.
    for second, error, row in zip(seconds, errors, chosen, strict=True):
        name = curve_name(row)
        if name in look.marker:
            axes.plot(second, error, look.marker[name], ms=5, color=look.colour[name], zorder=5)
    axes.plot(
        seconds, errors, "o", ms=11, mfc="none", mec="black", mew=1.3, ls="none",
        label="automatic choice",
    )  # fmt: skip
    asked = [(s, e, row.tol) for s, e, row in zip(seconds, errors, chosen, strict=True) if row.tol]
    for second, error, tol in asked:
        axes.plot([second, second], [error, tol], color="black", lw=0.7, alpha=0.45, zorder=0)
    if asked:
        axes.plot(
            [s for s, _, _ in asked], [tol for _, _, tol in asked], "_", ms=11, mew=1.8,
            color="black", label="what was asked of it",
        )  # fmt: skip


def _draw_star(axes: Axes, rows: Sequence[Row], kind: TimeKind) -> None:
    row = highlighted_row(rows, kind)
    if row is None:
        return
    seconds, errors = _points([row], kind)
    wanted = WANTED if cheapest_row(rows, kind) else None
    if wanted:
        axes.axhline(wanted, color=_STAR, lw=1, ls="--", zorder=0)
    label = f"cheapest for {format_error(wanted)}" if wanted else "cheapest near the best"
    axes.plot(seconds, errors, "*", ms=17, color=_STAR, mec="white", mew=0.8, label=label, zorder=6)
    axes.annotate(
        format_seconds(seconds[0]), (seconds[0], errors[0]), (-9, -9), textcoords="offset points",
        ha="right", va="top", color=_STAR, fontsize=10, fontweight="bold", zorder=7,
    )  # fmt: skip


def _set_scales(
    axes: Axes, rows: Sequence[Row], kind: TimeKind, fine: Sequence[float] = (1, 2, 5)
) -> None:
    """Give a diagram logarithmic scales with room for its marks, and plain numbers.

    fine: parts of a decade at which a scale of one or two decades has numbers.
    """
    good = [row for _, own in curves(rows, kind) for row in own]
    axes.set_xscale("log")
    axes.set_yscale("log")
    if not good:
        return
    seconds, errors = _points(good, kind)
    asked = [row.tol for row in chosen_rows(rows, kind) if row.tol]
    axes.set_xlim(min(seconds) / 3, max(seconds) * 2)
    low, high = min(errors), max([*errors, *asked])
    room = max(math.log10(high / low), 0.5)
    axes.set_ylim(low / 10 ** (0.14 * room), high * 10 ** (0.1 * room))
    axes.xaxis.set_major_formatter(FuncFormatter(_tick_seconds))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: format_error(value)))
    for axis, ends in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        decades = math.log10(ends[1] / ends[0])
        axis.set_minor_formatter(NullFormatter())
        if decades < 2.3:
            steps = fine if decades > 0.9 else (1, 1.5, 2, 3, 4, 5, 7)
            axis.set_major_locator(LogLocator(subs=steps))
    axes.grid(alpha=0.3)
    axes.tick_params(labelsize=8.5)


def _tick_seconds(seconds: float, _: int | None) -> str:
    return f"{1e3 * seconds:g} ms" if seconds < 0.9995 else f"{seconds:g} s"


def _draw_one(axes: Axes, rows: Sequence[Row], kind: TimeKind, look: _Look, name: str) -> None:
    """Draw one method as a line along what was asked, others in grey."""
    found = dict(curves(rows, kind))
    for other, own in found.items():
        if other != name:
            axes.plot(*_points(own, kind), ".", ms=3, color=_GREY, zorder=0)
    own = found[name]
    seconds, errors = _points(own, kind)
    axes.plot(seconds, errors, "-", lw=1.2, color=look.colour[name])
    axes.plot(seconds, errors, look.marker[name], ms=4.5, color=look.colour[name])
    _set_scales(axes, rows, kind, (1, 3))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_locator(NullLocator())  # too small for them
    _label_settings(axes, own, seconds, errors)
    axes.tick_params(labelsize=7)
    axes.set_xlabel(kind.name, fontsize=7.5)
    axes.set_xlim(right=2 * axes.get_xlim()[1])  # room for the last point's label
    title = textwrap.shorten(name, 40, placeholder=" …")
    axes.set_title(title, fontsize=9, color=look.colour[name], loc="left")


def _label_settings(
    axes: Axes, rows: Sequence[Row], seconds: Sequence[float], errors: Sequence[float]
) -> None:
    """Write what was asked beside a curve's points, as far as there is room."""
    last_place: tuple[float, float] | None = None
    for group in _neighbours(seconds, errors):
        place = seconds[group[0]], errors[group[0]]
        x, y = axes.transAxes.inverted().transform(axes.transData.transform(place))
        if last_place is not None and (
            abs(y - last_place[1]) < _APART and abs(x - last_place[0]) < 0.4
        ):
            continue
        last_place = x, y
        ends = [setting_name(rows[k]).partition(" ")[0] for k in (group[0], group[-1])]
        words = " … ".join(dict.fromkeys(filter(None, ends)))
        axes.annotate(words, place, (5, 3), textcoords="offset points", fontsize=7)


def _neighbours(seconds: Sequence[float], errors: Sequence[float]) -> list[list[int]]:
    """Group consecutive points that lie so close that they share a label."""
    groups: list[list[int]] = []
    for k in range(len(seconds)):
        if groups:
            first = groups[-1][0]
            apart = (seconds[k] / seconds[first], errors[k] / errors[first])
            if all(abs(math.log10(ratio)) < _NEAR for ratio in apart):
                groups[-1].append(k)
                continue
        groups.append([k])
    return groups
