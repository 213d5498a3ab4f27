"""The command that makes a report of a record."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.options import ForceOption, JsonOption, RecordArgument


@app.command()
def report(
    record: RecordArgument,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report. Default: the record's own.")
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Merge, measure, reconstruct, and write report.png and a self-contained report.html."""
    from labapp.files.places import REPORT_FILES
    from labapp.files.writing import require_free

    folder = out or record.parent
    require_free(folder, REPORT_FILES, force=force)
    from labapp.pictures.report import report_record

    report_record(record, folder, force=force, as_json=json)
