"""The command that takes what a record lacks."""

from __future__ import annotations

from labapp.cli.app import app
from labapp.cli.options import (
    BenchOption,
    FaultsOption,
    JsonOption,
    RecordArgument,
    SpeedOption,
    YesOption,
)


@app.command()
def resume(
    record: RecordArgument,
    bench: BenchOption = None,
    faults: FaultsOption = None,
    speed: SpeedOption = float("inf"),
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Take the frames that a record lacks: after a crash, a failure or Ctrl-C.

    Plan, patterns, seed and bench are the record's own, so that it ends as if nothing had
    happened. Frames that don't read back as they were stored are taken again.
    """
    from labapp.runs.running import Manner, resume_file

    resume_file(record, bench, faults, Manner(False, yes, speed, json))
