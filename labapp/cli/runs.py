"""Acquiring the frames of plans: `labapp run` and `labapp resume`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import (
    BenchOption,
    FaultsOption,
    ImageOption,
    JsonOption,
    RecordArgument,
    RunOptions,
    SpeedOption,
    WaitLimitOption,
    YesOption,
)


@app.command(cls=command_with_options(RunOptions()))
def run(
    context: typer.Context,
    plans: Annotated[
        list[Path],
        typer.Argument(
            metavar="PLAN...",
            help="Plan files (TOML, JSON) or names of ready plans; several run one after another.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(metavar="RUN.h5", help="Record to write; for several plans, their folder."),
    ],
    image: ImageOption = None,
) -> None:
    """Run acquisition plans on a bench (--bench), and write each frame at once to a record (--out).

    In a terminal, **p** pauses after the current frame, **r** continues, Enter answers a prompt,
    and Ctrl-C ends the run safely: the SLM is neutral, the filter parked, the camera stopped, and
    the record readable and marked CANCELLED. A full disk pauses the run until there is space, but
    no longer than --wait-limit; standard error says so at once.
    **labapp resume** takes the frames that a run lacks, and **labapp plan check** says beforehand
    what a run needs. For instance

    **labapp run psf-over-wavelengths --out wavelengths.h5**
    """
    from labapp.files.output_paths import run_output_paths
    from labapp.files.plan_file import read_plan

    asked, options = [read_plan(plan) for plan in plans], get_option_group(context, RunOptions)
    records = run_output_paths([one.path for one in asked], out, force=options.force)
    from labapp.runs.run_commands import run_files

    run_files(asked, records, options.bench_files(image), options.run_mode)


@app.command()
def resume(
    record: RecordArgument,
    bench: BenchOption = None,
    faults: FaultsOption = None,
    speed: SpeedOption = float("inf"),
    yes: YesOption = False,
    wait_limit: WaitLimitOption = None,
    json: JsonOption = False,
) -> None:
    """Take the frames that the record RUN.h5 lacks after a crash, a failure or Ctrl-C.

    Plan, patterns, seed and bench are read from the record, so that the result is that of an
    uninterrupted run. Frames that are damaged in the record are taken again. For instance

    **labapp resume wavelengths.h5**
    """
    from labapp.runs.run_commands import ExecutionOptions, resume_file

    execution = ExecutionOptions(False, yes, speed, json, wait_limit)
    resume_file(record, bench, faults, execution)
