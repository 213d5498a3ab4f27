"""`labapp accuracy` without a name: measures all operations, and writes the page."""

from __future__ import annotations

from pathlib import Path

from labapp.accuracy.overview.cases import OverviewSettings
from labapp.accuracy.overview.measuring import measure_all, write_outcome
from labapp.accuracy.overview.operations import OPERATIONS
from labapp.accuracy.overview.outcome import Outcome
from labapp.accuracy.reading import cheapest_sentence
from labapp.common.console import out, print_json, print_message, print_table, terminal_progress
from labapp.files.bench_file import read_camera
from labapp.files.output_paths import ACCURACY_FILES


def accuracy_page(
    camera: Path | None,
    folder: Path,
    *,
    as_json: bool,
    settings: OverviewSettings | None = None,
) -> None:
    """Measure what accuracy costs in every operation, write the page, and print its summary.

    camera: file of the camera that is measured; None for the bundled cases.
    settings: how much is measured.
    The process ends with exit code 130 if it was cancelled after something was measured; that is
    written all the same.
    """
    described = None if camera is None else read_camera(camera)
    scope = "Bundled cases" if camera is None else f"The camera of {camera.name}"
    with terminal_progress() as progress:
        outcome = measure_all(described, scope, progress, settings, OPERATIONS)
    write_outcome(outcome, folder)
    if as_json:
        print_json(outcome.as_data())
    else:
        _print_summary(outcome)
    for name in ACCURACY_FILES:
        print_message(f"wrote {folder / name}")
    if outcome.cancelled:
        count = f"{len(outcome.operations)} of {len(OPERATIONS)}"
        print_message(f"cancelled: {count} operations were measured, and are on the page")
        raise SystemExit(130)


def _print_summary(outcome: Outcome) -> None:
    """Print the cheapest settings, and what wasn't measured."""
    rows = [
        [one.title, kind.name.partition(":")[0], cheapest_sentence(one.rows, kind)]
        for one in outcome.operations
        for kind in one.kinds
    ]
    print_table("What accuracy costs", ["operation", "time of", "setting"], rows)
    for one in outcome.left_out:
        out.print(f"not measured: {one.title}: {one.why}")
    out.print(outcome.machine, style="dim")
