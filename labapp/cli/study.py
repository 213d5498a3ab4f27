"""`labapp study`, which repeats experiments of the thesis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import RunOptions, SeedOption, existing_path
from labapp.studies import STUDIES


def _help() -> str:
    """Return the help text with the list of studies."""
    listed = "\n".join(
        f"- **{name}**: {entry.summary} ({entry.figure})" for name, entry in STUDIES.items()
    )
    return f"""Repeat an experiment of the thesis on a bench, beside the published result.

    A study runs a plan and evaluates its record. It writes **run.h5**, **study.png**, a page
    **study.html** and **study.json** to a folder, and prints the published result, the value that
    physics predicts, and the measured value.

{listed}

**labapp study list** gives their settings with units and defaults. For instance

**labapp study refocus near_m=1.7 --out refocus**

Ctrl-C leaves the bench safe and keeps the record: **labapp resume** takes the missing frames, and
**labapp study NAME --record run.h5 --out FOLDER** evaluates the record. Your own bench (--bench)
needs targets with the names in the study's plan, such as star and dark.
"""


@app.command(cls=command_with_options(RunOptions()), help=_help())
def study(
    context: typer.Context,
    name: Annotated[str, typer.Argument(metavar="NAME", help="A study, or 'list'.")],
    settings: Annotated[
        list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Settings of the study.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder for record, picture and page.")
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN.h5",
            callback=existing_path,
            help="Evaluate an existing record of the study instead of taking pictures.",
        ),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Use smaller settings: seconds instead of a minute."),
    ] = False,
    seed: SeedOption = 1,
) -> None:
    from labapp.common.errors import UserError
    from labapp.files.output_paths import RECORD, STUDY_FILES
    from labapp.files.writing import require_free_names
    from labapp.studies.study_lookup import find_study, list_studies, read_study_settings

    options = get_option_group(context, RunOptions)
    if name == "list":
        list_studies(as_json=options.json)
        return
    find_study(name)
    if out is None:
        raise UserError("there is no --out. Name a folder for record, picture and page.")
    if record is None:
        read_study_settings(name, settings or (), quick=quick)
    elif settings or quick:
        raise UserError("--record: its settings are in it. Leave the others out.")
    names = STUDY_FILES if record else (RECORD, *STUDY_FILES)
    require_free_names(out, names, force=options.force)
    from labapp.studies.command import StudyRequest, evaluate_record, run_study

    if record is not None:
        evaluate_record(name, record, out, options.run_mode)
        return
    bench = (options.bench, options.scene, options.faults)
    run_study(StudyRequest(name, tuple(settings or ()), seed, quick, *bench), out, options.run_mode)
