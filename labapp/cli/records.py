"""Commands that read records: to show, to report, to check, to hand on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import ForceOption, JsonOption, RecordArgument


@app.command()
def show(record: RecordArgument, json: JsonOption = False) -> None:
    """Say what a record holds: state, devices, frames, the simulator's decisions, log."""
    from labapp.runs.record_summary import show_record

    show_record(record, as_json=json)


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
    from labapp.files.output_paths import REPORT_FILES
    from labapp.files.writing import require_free_names

    folder = out or record.parent
    require_free_names(folder, REPORT_FILES, force=force)
    from labapp.pictures.report import report_record

    report_record(record, folder, force=force, as_json=json)


@app.command()
def verify(record: RecordArgument, json: JsonOption = False) -> None:
    """Check that a record is whole: every frame, its checksum, patterns, settings, state.

    The exit code is 0 only if all is well. For a record that isn't, the last line says what
    to do about it.
    """
    from labapp.runs.verifying import verify_record

    raise typer.Exit(0 if verify_record(record, as_json=json) else 1)


@app.command()
def export(
    record: RecordArgument,
    to: Annotated[str, typer.Option(metavar="KIND", help="tiff, png, ome-tiff or npy.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where to; made if need be.")],
    frames: Annotated[
        str | None, typer.Option(metavar="LIST", help="Only these frames: 0-9,12.")
    ] = None,
    target: Annotated[str | None, typer.Option(help="Only frames of this target.")] = None,
    pattern: Annotated[str | None, typer.Option(help="Only frames of this pattern.")] = None,
    force: ForceOption = False,
) -> None:
    """Write frames as files that other programs read, raw and lossless.

    **tiff**, **png**: a 16-bit picture a frame. **ome-tiff**: one file with exposure and time
    of each plane. **npy**: one array, and what is known of it as JSON. With every kind comes
    a table, frames.csv. Digital numbers aren't scaled, so that pictures of a 12-bit camera
    look dark in a viewer that doesn't stretch them. Frames that the record lacks are named,
    and the exit code is 1.
    """
    from labapp.runs.export import FrameSelection, export_record

    export_record(record, to, out, FrameSelection(frames, target, pattern), force=force)
