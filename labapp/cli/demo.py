"""`labapp demo`, which takes and restores a coded photograph."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import ForceOption, ImageOption, JsonOption


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for run.h5, report.png, report.html.")] = Path(
        "first-light"
    ),
    image: ImageOption = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the run; the same seed gives the same data.")
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Take a coded photograph on the virtual bench, undo the coding, and write a report to --out.

    A pattern with a ring-shaped PSF is computed for the SLM. Its PSF is measured on an artificial
    star, a photograph is taken through it and restored. This takes a few seconds and writes a
    record and a report. For instance

    **labapp demo --out first-light**
    """
    from labapp.files.output_paths import RECORD, REPORT_FILES
    from labapp.files.writing import require_free_names

    require_free_names(out, (RECORD, *REPORT_FILES), force=force)
    from labapp.studies.demo import run_demo

    run_demo(out, image=image, seed=seed, force=force, as_json=json)
