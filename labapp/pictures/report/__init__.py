"""The report of a run: terminal tables, report.png, and a self-contained report.html."""

from __future__ import annotations

from pathlib import Path

from labapp.common.console import out as console
from labapp.common.console import print_json, terminal_progress
from labapp.common.errors import UserError
from labapp.common.stopwatch import Stopwatch
from labapp.files.output_paths import REPORT_FILES
from labapp.files.writing import require_free_names, write_atomically
from labapp.pictures.report.record_analysis import RecordAnalysis, analyse_record
from labapp.pictures.report.tables import as_data, print_tables

__all__ = [
    "as_data",
    "print_tables",
    "report_record",
    "write_report",
]


def report_record(
    record: Path, folder: Path, *, force: bool, as_json: bool, readout: int | None = None
) -> None:
    """Analyse a record, write report.png and report.html, and print the tables.

    Parameters
    ----------
    record : Path
        Record of a run.
    folder : Path
        Existing folder for report.png and report.html.
    force : bool
        Whether existing reports are replaced.
    as_json : bool
        Whether the figures are printed as JSON instead of as tables.
    readout : int, optional
        Number of the way in which the sensor was read, where the run had several.

    Raises
    ------
    UserError
        If the folder is missing, a report exists already, or frames that the reconstruction needs
        are missing.
    """
    require_free_names(folder, REPORT_FILES, force=force)
    if not folder.is_dir():
        raise UserError(f"{folder}: is not a folder. Make it first, or choose another place.")
    with terminal_progress() as progress:
        analysis = analyse_record(record, progress.part(0, 0.8), readout=readout)
        progress.report(0.8, "report")
        write_report(analysis, folder)
    if as_json:
        print_json(as_data(analysis))
        return
    print_tables(analysis)
    for name in REPORT_FILES:
        console.print(f"wrote {folder / name}")


def write_report(analysis: RecordAnalysis, folder: Path) -> None:
    """Write report.png and report.html into a folder.

    Each file appears under its name only when it is complete. The time that writing takes is added
    to the times of the analysis.

    Parameters
    ----------
    analysis : RecordAnalysis
        Results of the record.
    folder : Path
        Existing folder.
    """
    from labapp.common.figure_png import figure_to_png
    from labapp.pictures.report.figures import overview
    from labapp.pictures.report.page import report_page

    watch = Stopwatch()
    with watch.stage("report"):
        write_atomically(folder / "report.png", figure_to_png(overview(analysis)))
        write_atomically(folder / "report.html", report_page(analysis).encode())
    analysis.seconds |= watch.seconds
