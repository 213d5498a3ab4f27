"""The command that checks a record."""

from __future__ import annotations

import typer

from labapp.cli.app import app
from labapp.cli.options import JsonOption, RecordArgument


@app.command()
def verify(record: RecordArgument, json: JsonOption = False) -> None:
    """Check that a record is whole: every frame, its checksum, patterns, settings, state.

    The exit code is 0 only if all is well. For a record that isn't, the last line says what
    to do about it.
    """
    from labapp.runs.verifying import verify_record

    raise typer.Exit(0 if verify_record(record, as_json=json) else 1)
