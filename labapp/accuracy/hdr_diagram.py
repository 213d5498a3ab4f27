"""What a merge of an exposure bracket reached: its row, and the diagram of many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from labapp.accuracy.diagram import footing_lines
from labapp.accuracy.work_precision import Row

ERROR_NAME = "error of the light, relative"


@dataclass(frozen=True)
class MergeRow(Row):
    """Measured error and time of a merge.

    error_achieved: root mean square of relative errors over all levels of light.
    error_predicted: the same as the merge states it.
    frames: number of exposures.
    exposure_s: sum of the exposure times, seconds.
    efficiency, least_efficiency: least variance of any unbiased estimate (Cramér and Rao) over the
    mean squared error: of the sums over all levels, and at the level where it's least.
    bias: largest mean relative error of a level that isn't chance; 0 if all may be.
    """

    frames: int = 0
    exposure_s: float = 0.0
    efficiency: float | None = None
    least_efficiency: float | None = None
    bias: float | None = None


_MARKERS = "osD^vP"


def draw_merges(name: str, rows: Sequence[MergeRow]) -> Figure:
    """Draw merges' errors: by exposures, with what is possible, and by time.

    Merges that fail are named in sentences under the diagram.
    """
    lines = footing_lines(rows)
    footing, height = 0.2 + 0.19 * len(lines), 5.0
    low = footing / (height + footing)
    layout = ConstrainedLayoutEngine(rect=(0, low, 1, 1 - low))
    figure = Figure(figsize=(12, height + footing), dpi=100, layout=layout)
    left, right = figure.subplots(1, 2, sharey=True)
    good = [row for row in rows if not row.failure]
    _draw_by_exposures(left, good)
    _draw_by_time(right, good)
    left.set_ylabel(ERROR_NAME)
    left.set_title(name, loc="left", fontsize=10)
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=4, fontsize=8.5)
    figure.text(0.01, 0.06 / (height + footing), "\n".join(lines), fontsize=8, color="#444444")
    return figure


def _methods(rows: Sequence[MergeRow]) -> dict[str, list[MergeRow]]:
    """Return the rows of each merge, in the order of exposures."""
    found: dict[str, list[MergeRow]] = {}
    for row in sorted(rows, key=lambda row: row.frames):
        found.setdefault(row.method, []).append(row)
    return found


def _draw_by_exposures(axes: Axes, rows: Sequence[MergeRow]) -> None:
    """Draw errors by the number of exposures, labelled with their total time."""
    for (method, own), mark in zip(_methods(rows).items(), _MARKERS, strict=False):
        axes.plot([row.frames for row in own], _errors(own), f"{mark}-", label=method, alpha=0.85)
    bounds = {
        row.frames: (row.error_achieved or 0.0) * math.sqrt(row.efficiency)
        for row in rows
        if row.efficiency
    }
    counts = sorted(bounds)
    axes.plot(
        counts, [bounds[one] for one in counts], "--", color="black", lw=1,
        label="least of any unbiased estimate",
    )  # fmt: skip
    times = {row.frames: row.exposure_s for row in rows}
    axes.set(xscale="log", yscale="log", xlabel="exposures, and their total time")
    axes.set_xticks(counts, [f"{one}\n{times[one]:.3g} s" for one in counts])
    axes.set_xticks([], minor=True)
    axes.grid(alpha=0.3)


def _draw_by_time(axes: Axes, rows: Sequence[MergeRow]) -> None:
    for own, mark in zip(_methods(rows).values(), _MARKERS, strict=False):
        milliseconds = [1e3 * (row.cpu_s or 0.0) for row in own]
        axes.plot(milliseconds, _errors(own), f"{mark}-", alpha=0.85)
    axes.set(xscale="log", xlabel="processor time of one merge, ms")
    axes.set_title("each method from few exposures, above, to many", loc="left", fontsize=10)
    axes.grid(alpha=0.3)


def _errors(rows: Sequence[MergeRow]) -> list[float]:
    return [row.error_achieved or math.nan for row in rows]
