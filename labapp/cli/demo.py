"""The command that shows everything at once."""

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
    seed: Annotated[int | None, typer.Option(help="Seed of the run; same seed, same data.")] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Take a whole coded photograph on the virtual bench, and undo the coding.

    A ring-shaped PSF is computed for the SLM, measured on an artificial star, and used to
    photograph and to reconstruct. Takes a few seconds; writes a record and a report.
    """
    from labapp.files.output_paths import RECORD, REPORT_FILES
    from labapp.files.writing import require_free_names

    require_free_names(out, (RECORD, *REPORT_FILES), force=force)
    from labapp.studies.demo import run_demo

    run_demo(out, image=image, seed=seed, force=force, as_json=json)
