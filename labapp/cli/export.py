"""The command that writes frames for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.options import ForceOption, RecordArgument


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
    from labapp.runs.export import Choice, export_record

    export_record(record, to, out, Choice(frames, target, pattern), force=force)
