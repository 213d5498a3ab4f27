"""The report of a run: tables in the terminal, report.png, and a self-contained report.html."""

from __future__ import annotations

from pathlib import Path

from labapp.common.console import out as console
from labapp.common.console import print_json, watched
from labapp.common.errors import UserError
from labapp.common.stopwatch import Stopwatch
from labapp.files.places import REPORT_FILES
from labapp.files.writing import require_free, write_whole
from labapp.pictures.report.analysis import Analysis, analyse
from labapp.pictures.report.tables import as_data, print_tables

__all__ = [
    "as_data",
    "print_tables",
    "report_record",
    "write_report",
]


def report_record(record: Path, folder: Path, *, force: bool, as_json: bool) -> None:
    """Analyse a record and write its report into a folder."""
    require_free(folder, REPORT_FILES, force=force)
    if not folder.is_dir():
        raise UserError(f"{folder}: is not a folder. Make it first, or choose another place.")
    with watched() as progress:
        analysis = analyse(record, progress.part(0, 0.8))
        progress.report(0.8, "report")
        write_report(analysis, folder)
    if as_json:
        print_json(as_data(analysis))
        return
    print_tables(analysis)
    for name in REPORT_FILES:
        console.print(f"wrote {folder / name}")


def write_report(analysis: Analysis, folder: Path) -> None:
    """report.png and report.html; each takes its name only when it is whole."""
    from labapp.common.drawing import png
    from labapp.pictures.report.page import page
    from labapp.pictures.report.pictures import overview

    watch = Stopwatch()
    with watch.stage("report"):
        write_whole(folder / "report.png", png(overview(analysis)))
        write_whole(folder / "report.html", page(analysis).encode())
    analysis.seconds |= watch.seconds
