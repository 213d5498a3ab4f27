"""The command `labapp bracket`: choose an exposure bracket on a bench, beside ladders."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.bench.opening import Bench, BenchFiles, open_bench
from labapp.common.console import out, print_json, print_table
from labapp.common.figure_png import figure_to_png
from labapp.files.bracket_table import BracketTable, ChosenTable
from labapp.files.plan_file import Acquisition, PlanFile
from labapp.files.quantities import exposure_from_ms
from labapp.files.reading import validate
from labapp.files.writing import require_all_writable, write_atomically
from labapp.patterns.grey_levels import compute_patterns
from labapp.runs.acquisition.bracket_metering import BracketMetering
from labapp.runs.acquisition.feasibility import expected_plan, feasible_shots
from labapp.runs.acquisition.hooks import Hooks
from labapp.runs.brackets.choice import bracket_limits, equal_ladders, wanted_snr
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.run_commands import ExecutionOptions, attended_run
from optics.hdr import ChosenBracket
from optics.hdr.exposures import ExposureSNR

_SOURCE = "bracket"
"""Name of the command's plan in errors."""

_POINTS = 400
"""Rates at which the diagram's curves are computed. Chosen: finer than a line is wide."""


@dataclass(frozen=True)
class BracketCommand:
    """What a bracket is chosen for.

    wanted: ratio, range and limits.
    target, pattern: of the metering; no pattern is the neutral one.
    wavelength_nm: of the filter.
    darks: dark frames at each exposure.
    any_exposure: whether exposures may end within the lamp's flicker.
    plot: picture to write.
    """

    wanted: BracketTable
    target: str
    pattern: Path | None
    wavelength_nm: float
    darks: int | None
    any_exposure: bool
    plot: Path | None


def choose_for_bench(
    request: BracketCommand, files: BenchFiles, execution: ExecutionOptions
) -> None:
    """Choose a bracket, by metering a target on a bench unless its range is given, and print it.

    Raises UserError if it can't be had, with what can.
    """
    require_all_writable((request.plot,), force=execution.force)
    plan = _build_plan(request)
    with open_bench(files, speed=execution.speed) as bench:
        settled = _settle(plan, bench, execution)
        brackets = _brackets(plan, settled, bench)
    (block,) = settled.acquire
    assert block.chosen is not None
    if request.plot is not None:
        rates = np.geomspace(*block.chosen.electrons_per_s, _POINTS)
        figure = draw_brackets(brackets, rates, request.wanted.snr_db)
        write_atomically(request.plot, figure_to_png(figure))
    if execution.as_json:
        print_json(_as_data(block, brackets))
    else:
        _print(block, block.chosen, brackets)


def _build_plan(request: BracketCommand) -> PlanFile:
    """Return a plan of one block with the bracket that the command asks for."""
    shown: dict[str, Any] = {"kind": "constant", "grey": 0}
    if request.pattern is not None:
        shown = {"kind": "image", "file": str(request.pattern.resolve())}
    block: dict[str, Any] = {
        "targets": [request.target],
        "patterns": ["shown"],
        "wavelengths_nm": [request.wavelength_nm],
        "bracket": request.wanted.model_dump(),
        "any_exposure": request.any_exposure,
    }
    if request.darks:
        block["interleave"] = [{"role": "dark", "pattern": "shown", "frames": request.darks}]
    table = {"version": 1, "title": "Bracket", "patterns": {"shown": shown}, "acquire": [block]}
    return validate(table, PlanFile, _SOURCE)


def _settle(plan: PlanFile, bench: Bench, execution: ExecutionOptions) -> PlanFile:
    """Return the plan with the exposures that were chosen; the bench is left safe."""
    abilities = BenchCapabilities.of(bench)
    possible = expected_plan(plan, abilities, bench.description.sensor, _SOURCE)
    feasible_shots(possible, abilities, _SOURCE)
    with attended_run(execution) as attendance:
        progress = attendance.progress
        patterns = compute_patterns(
            plan.patterns, bench.description, plan.seed, progress.part(0, 0.3), Path()
        )
        metering = replace(attendance, progress=progress.part(0.3, 1))
        settled = BracketMetering(bench, plan, patterns, metering, _SOURCE, Hooks()).settle()
        bench.make_safe()
    return settled


def _brackets(plan: PlanFile, settled: PlanFile, bench: Bench) -> dict[str, ChosenBracket]:
    """Return the chosen bracket, and ladders that reach the same, by name."""
    (block,), (chosen,) = plan.acquire, settled.acquire
    assert chosen.chosen is not None
    assert chosen.exposures_ms is not None
    sensor = bench.description.sensor
    limits = bracket_limits(block, plan, BenchCapabilities.of(bench), _SOURCE)
    wanted = wanted_snr(block, *chosen.chosen.electrons_per_s, 1)
    times = [exposure_from_ms(ms) for ms in chosen.exposures_ms]
    groups = tuple((time, times.count(time)) for time in dict.fromkeys(times))
    seconds = sum((n + wanted.counted_darks) * (time + limits.readout) for time, n in groups)
    found = ChosenBracket(groups, seconds, ExposureSNR(sensor, wanted.darks))
    return {"chosen": found, **equal_ladders(sensor, wanted, limits)}


def _half_decades(low: float, high: float) -> NDArray[np.float64]:
    """Return both ends of a range and the half decades between them, in electrons/s."""
    first, last = math.ceil(2 * math.log10(low)), math.floor(2 * math.log10(high))
    inner = 10 ** (np.arange(first, last + 1) / 2)
    return np.unique(np.concatenate([[low], inner[(inner > low) & (inner < high)], [high]]))


def _print(block: Acquisition, chosen: ChosenTable, brackets: dict[str, ChosenBracket]) -> None:
    """Print the chosen bracket, its ratio over the range, and ladders that reach the same."""
    low, high = chosen.electrons_per_s
    out.print(chosen.wanted.describe(), style="bold", markup=False)
    for one in chosen.metered:
        listed = ", ".join(f"{ms:g}" for ms in one.exposures_ms)
        out.print(
            f"metered {one.target}: {low:.3g} to {high:.3g} electrons/s, by frames of {listed} ms "
            f"in {chosen.metering_seconds:.3g} s",
            markup=False,
        )
        if one.noise_limited:
            out.print("the darkest pixels can't be told from darkness; the range begins above them")
        if one.remark:
            out.print(f"WARNING: {one.remark}", style="bold", markup=False)
    out.print()
    rows = [[f"{time * 1e3:g}", count] for time, count in brackets["chosen"].groups]
    print_table("Exposures", ["ms ", "frames "], rows)
    names = list(brackets)
    rates = _half_decades(low, high)
    columns = [brackets[name].snr_db(rates) for name in names]
    rows = [
        [f"{rate:.3g}", *(f"{column[n]:.1f}" for column in columns)] for n, rate in enumerate(rates)
    ]
    # A blank at the end of a heading aligns its numbers right.
    headings = ["electrons/s ", *(f"{name} " for name in names)]
    print_table("Signal-to-noise ratio in dB", headings, rows)
    totals = [[name, one.frames, f"{one.duration:.4g}"] for name, one in brackets.items()]
    taken = "s with dark frames " if chosen.darks else "s with read-out "
    print_table("Beside ladders that reach the same", ["bracket", "frames ", taken], totals)
    exposures = ", ".join(f"{ms:g}" for ms in block.exposures_ms or ())
    out.print(f"In a plan: exposures_ms = [{exposures}]", markup=False, soft_wrap=True)


def _as_data(block: Acquisition, brackets: dict[str, ChosenBracket]) -> dict[str, Any]:
    assert block.chosen is not None
    rates = _half_decades(*block.chosen.electrons_per_s)
    return {
        "exposures_ms": list(block.exposures_ms or ()),
        **block.chosen.model_dump(
            mode="json", exclude={"metered": {"__all__": {"blocks", "quantiles"}}}
        ),
        "rates": rates.tolist(),
        "snr_db": {
            name: [round(float(value), 3) for value in np.maximum(one.snr_db(rates), -200)]
            for name, one in brackets.items()
        },
    }


_LOOK = {"chosen": ("#c0392b", 2.2), "x2": ("#2c7fb8", 1.2), "x4": ("#41ab5d", 1.2)}
"""Colour and width of a bracket's line; the ladder that isn't named is grey."""


def draw_brackets(
    brackets: Mapping[str, ChosenBracket], rates: NDArray[np.float64], wanted_db: float
) -> Figure:
    """Draw the chosen bracket with ladders that reach the same.

    rates: electrons/s.
    """
    figure = Figure(figsize=(8, 4.5), dpi=120, layout="constrained")
    axes = figure.subplots()
    for name, bracket in brackets.items():
        colour, width = _LOOK.get(name, ("#888888", 1.2))
        label = f"{name}: {bracket.frames} frames"
        axes.plot(rates, bracket.snr_db(rates), color=colour, lw=width, label=label)
    axes.axhline(wanted_db, color="black", lw=1, ls="--", label=f"wanted: {wanted_db:g} dB")
    axes.set_xscale("log")
    axes.set_xlabel("rate in electrons/s")
    axes.set_ylabel("signal-to-noise ratio in dB")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", fontsize=9)
    return figure
