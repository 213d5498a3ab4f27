"""Commands that take pictures: the demo, runs, and what is left of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.options import (
    BenchOption,
    FaultsOption,
    ForceOption,
    ImageOption,
    JsonOption,
    RecordArgument,
    SceneOption,
    SpeedOption,
    YesOption,
)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for run.h5, report.png, report.html.")] = Path(
        "first-light"
    ),
    image: ImageOption = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the run; same seed, same data.")] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Take a whole coded photograph on the virtual bench, and undo the coding.

    A ring-shaped PSF is computed for the SLM, measured on an artificial star, and used to
    photograph and to reconstruct. Takes a few seconds; writes a record and a report.
    """
    from labapp.files.places import RECORD, REPORT_FILES
    from labapp.files.writing import require_free

    require_free(out, (RECORD, *REPORT_FILES), force=force)
    from labapp.studies.demo import run_demo

    run_demo(out, image=image, seed=seed, force=force, as_json=json)


@app.command()
def run(
    plans: Annotated[
        list[Path],
        typer.Argument(
            metavar="PLAN...", help="Plan files (TOML, JSON) or ready plans; several run in turn."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="RUN.h5", help="Record to write; of several plans a folder."),
    ],
    bench: BenchOption = None,
    scene: SceneOption = None,
    image: ImageOption = None,
    faults: FaultsOption = None,
    speed: SpeedOption = float("inf"),
    yes: YesOption = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Run acquisition plans on a bench, every frame to disk as it comes.

    In a terminal, **p** pauses after the frame, **r** goes on, Enter answers a prompt, and
    Ctrl-C ends the run safely: SLM neutral, filter parked, camera stopped, the record
    readable and marked CANCELLED. A full disk pauses the run until there is space. Whatever
    ended a run, **labapp resume** takes the frames that it lacks. **labapp plan check** says
    beforehand what a run will take.
    """
    from labapp.files.places import places_of_runs
    from labapp.files.plan_file import read_plan

    asked = [read_plan(plan) for plan in plans]
    records = places_of_runs([one.path for one in asked], out, force=force)
    from labapp.bench.opening import BenchFiles
    from labapp.runs.running import Manner, run_files

    files = BenchFiles.default(bench, scene, image, faults)
    run_files(asked, records, files, Manner(force, yes, speed, json))


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
