"""`labapp demo`: first light, from nothing to a report."""

from __future__ import annotations

from pathlib import Path

from labapp.bench.opening import BenchFiles, open_bench
from labapp.common.console import out, print_json, watched
from labapp.common.stopwatch import Stopwatch
from labapp.files.places import RECORD, REPORT_FILES
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled, read_file
from labapp.files.writing import make_folder, require_free
from labapp.pictures.report import as_data, print_tables, write_report
from labapp.pictures.report.analysis import Analysis, analyse
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.running import require_complete
from optics.progress import Progress


def run_demo(
    folder: Path, *, image: Path | None, seed: int | None, force: bool, as_json: bool
) -> None:
    """Run the bundled plan on the bundled bench, analyse it, and write record and report."""
    with watched() as progress:
        analysis = first_light(folder, image=image, seed=seed, force=force, progress=progress)
    if as_json:
        print_json(as_data(analysis))
        return
    print_tables(analysis)
    for name in (RECORD, *REPORT_FILES):
        out.print(f"wrote {folder / name}")


def first_light(
    folder: Path,
    *,
    image: Path | None = None,
    seed: int | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Analysis:
    """The whole demo without a word: run.h5, report.png and report.html in a folder.

    UserError if a file is there already, or the folder can't be written.
    """
    progress = progress or Progress()
    plan = read_file(bundled("first_light.toml"), PlanFile)
    if seed is not None:
        plan = plan.model_copy(update={"seed": seed})
    require_free(folder, (RECORD, *REPORT_FILES), force=force)
    watch = Stopwatch()
    with open_bench(BenchFiles.default(image=image)) as bench:
        make_folder(folder)
        outcome = run_plan(
            bench,
            plan,
            folder / RECORD,
            source="first_light.toml",
            force=force,
            progress=progress.part(0, 0.7),
            watch=watch,
        )
    require_complete(outcome)
    analysis = analyse(outcome.path, progress.part(0.7, 0.9))
    analysis.seconds = watch.seconds | analysis.seconds
    progress.report(0.9, "report")
    write_report(analysis, folder)
    return analysis
