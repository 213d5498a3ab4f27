"""What is done with the record of a run: show, report, verify, salvage and export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import ForceOption, JsonOption, ReadoutOption, RecordArgument


@app.command()
def show(record: RecordArgument, json: JsonOption = False) -> None:
    """Print what the record RUN.h5 holds: state, devices, frames, the simulator's decisions, log.

    For instance

    **labapp show first-light/run.h5**
    """
    from labapp.runs.record_summary import show_record

    show_record(record, as_json=json)


@app.command()
def report(
    record: RecordArgument,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report. Default: the record's own.")
    ] = None,
    readout: ReadoutOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Analyse the record RUN.h5, and write report.png and a self-contained report.html (--out).

    Exposures are merged, the PSF is measured on the star, and the photograph is restored as the
    plan says. For instance

    **labapp report first-light/run.h5 --force**
    """
    from labapp.files.output_paths import REPORT_FILES
    from labapp.files.writing import require_free_names

    folder = out or record.parent
    require_free_names(folder, REPORT_FILES, force=force)
    from labapp.pictures.report import report_record

    report_record(record, folder, force=force, as_json=json, readout=readout)


@app.command()
def verify(
    record: RecordArgument,
    digest: Annotated[
        str,
        typer.Option(
            metavar="DIGEST",
            help="Digest that the end of the run printed, to compare the record with.",
        ),
    ] = "",
    json: JsonOption = False,
) -> None:
    """Check that the record RUN.h5 is complete and unchanged: frames, settings, patterns, log.

    SHA-256 digests, which are chained while the record is written, tell any change. Somebody who
    makes all of them anew can still hide one: keep the digest that the run prints at its end in
    another place, and give it as --digest. The exit code is 0 only if all is well. Otherwise the
    last line says what to do. For instance

    **labapp verify first-light/run.h5**
    """
    from labapp.runs.verifying import verify_record

    raise typer.Exit(0 if verify_record(record, as_json=json, digest=digest) else 1)


@app.command()
def salvage(
    record: RecordArgument,
    out: Annotated[Path, typer.Option(metavar="NEW.h5", help="New record for what is saved.")],
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Save every whole frame of the damaged or truncated record RUN.h5 into a new one (--out).

    Frames are saved with their settings if their digests show that they are whole. What is lost is
    printed, and stands in the new record's log; **labapp resume** takes the lost frames again,
    where plan and bench are saved. The damaged file isn't changed. For instance

    **labapp salvage damaged.h5 --out saved.h5**
    """
    from labapp.runs.salvaging import salvage_record

    salvage_record(record, out, force=force, as_json=json)


@app.command()
def export(
    record: RecordArgument,
    to: Annotated[
        str, typer.Option(metavar="KIND", help="Kind of files: tiff, png, ome-tiff or npy.")
    ],
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Folder to write to; created if it's missing.")
    ],
    frames: Annotated[
        str | None, typer.Option(metavar="LIST", help="Only these frames, such as 0-9,12.")
    ] = None,
    target: Annotated[str | None, typer.Option(help="Only frames of this target.")] = None,
    pattern: Annotated[str | None, typer.Option(help="Only frames of this pattern.")] = None,
    readout: ReadoutOption = None,
    force: ForceOption = False,
) -> None:
    """Write the raw frames of the record RUN.h5 as lossless files (--to) for other programs.

    **tiff** and **png** are a 16-bit picture for each frame, **ome-tiff** is one file with the
    exposure and time of each plane, **npy** is one array with its metadata as JSON. Each kind comes
    with a table, frames.csv. Digital numbers aren't scaled, so that pictures of a 12-bit camera
    look dark in a viewer that doesn't stretch them. Frames that the record lacks are listed, and
    the exit code is then 1. For instance

    **labapp export first-light/run.h5 --to ome-tiff --out pictures**
    """
    from labapp.runs.export import FrameSelection, export_record

    selection = FrameSelection(frames, target, pattern, readout)
    export_record(record, to, out, selection, force=force)
