"""The command `labapp demo`: run the first-light plan on the virtual bench and report on it."""

from __future__ import annotations

from pathlib import Path

from labapp.bench.opening import BenchFiles, open_bench
from labapp.common.console import out, print_json, terminal_progress
from labapp.common.stopwatch import Stopwatch
from labapp.files.output_paths import RECORD, REPORT_FILES
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled_path, read_file
from labapp.files.writing import make_folder, require_free_names
from labapp.pictures.report import as_data, print_tables, write_report
from labapp.pictures.report.record_analysis import RecordAnalysis, analyse_record
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.run_commands import require_complete
from optics.progress import Progress


def run_demo(
    folder: Path, *, image: Path | None, seed: int | None, force: bool, as_json: bool
) -> None:
    """Run the bundled plan on the bundled bench, write record and report, and print tables."""
    with terminal_progress() as progress:
        analysis = run_first_light(folder, image=image, seed=seed, force=force, progress=progress)
    if as_json:
        print_json(as_data(analysis))
        return
    print_tables(analysis)
    for name in (RECORD, *REPORT_FILES):
        out.print(f"wrote {folder / name}")


def run_first_light(
    folder: Path,
    *,
    image: Path | None = None,
    seed: int | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> RecordAnalysis:
    """Run the first-light plan without printing: run.h5, report.png, report.html in a folder.

    Raises UserError if a file exists already, or the folder can't be written.
    """
    progress = progress or Progress()
    plan = read_file(bundled_path("first_light.toml"), PlanFile)
    if seed is not None:
        plan = plan.model_copy(update={"seed": seed})
    require_free_names(folder, (RECORD, *REPORT_FILES), force=force)
    watch = Stopwatch()
    with open_bench(BenchFiles.with_defaults(image=image)) as bench:
        make_folder(folder)
        outcome = run_plan(
            bench,
            plan,
            folder / RECORD,
            Attendance(progress=progress.part(0, 0.7)),
            source="first_light.toml",
            force=force,
            stopwatch=watch,
        )
    require_complete(outcome)
    analysis = analyse_record(outcome.path, progress.part(0.7, 0.9))
    analysis.seconds = watch.seconds | analysis.seconds
    progress.report(0.9, "report")
    write_report(analysis, folder)
    return analysis
