"""The command that says what a record holds."""

from __future__ import annotations

from labapp.cli.app import app
from labapp.cli.options import JsonOption, RecordArgument


@app.command()
def show(record: RecordArgument, json: JsonOption = False) -> None:
    """Say what a record holds: state, devices, frames, the simulator's decisions, log."""
    from labapp.runs.showing import show_record

    show_record(record, as_json=json)
