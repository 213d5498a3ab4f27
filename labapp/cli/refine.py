"""`labapp refine`, which corrects a pattern by pictures of its PSF."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import RunOptions, StarOptions, existing_path
from labapp.common.errors import UserError
from labapp.common.threads import use_one_thread


@app.command(cls=command_with_options(StarOptions(), RunOptions()))
def refine(
    context: typer.Context,
    design: Annotated[
        Path, typer.Argument(metavar="DESIGN.h5", help="Design that labapp retrieve wrote.")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="BETTER.h5", help="Refined design to write.")
    ] = None,
    pictures: Annotated[
        int,
        typer.Option(
            help="Number of pictures; the first shows the original design, the last only checks."
        ),
    ] = 5,
    exposures_ms: Annotated[
        str,
        typer.Option(
            metavar="MS,...",
            help="Exposure times of each picture in milliseconds; for a video, whole periods. "
            'Two need a semicolon, as "2;20": one comma may be a decimal sign.',
        ),
    ] = "1,8,64",
    runs: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder for the records.  [BETTER_runs, beside]"),
    ] = None,
) -> None:
    """Correct the retrieved pattern or video in DESIGN.h5 with pictures of its PSF.

    **labapp refine ring.h5 --out better.h5**

    shows the design on the bench and photographs the star through it. After each picture the target
    gets more light where the camera saw too little. **better.h5** is the design of the best
    picture, and **better_psf.png** shows the PSF before and after. This also corrects errors that
    the camera's description and its calibration don't include. Calibrate the bench first. Videos
    gain most.
    """
    if out is None:
        raise UserError("there is no --out. Name an .h5 file to write.")
    existing_path(design)
    use_one_thread()
    from labapp.refining.command import refine_design
    from labapp.refining.refinement_request import RefinementRequest, parse_milliseconds

    request = RefinementRequest.from_options(
        pictures=pictures,
        exposures_ms=parse_milliseconds(exposures_ms),
        **vars(get_option_group(context, StarOptions)),
    )
    options = get_option_group(context, RunOptions)
    refine_design(design, out, runs, request, options.bench_files(), options.run_mode)
