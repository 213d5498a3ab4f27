"""The command that corrects a design by what the bench's camera sees of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.optics import one_thread
from labapp.cli.options import (
    BenchOption,
    DarkOption,
    FaultsOption,
    ForceOption,
    JsonOption,
    SceneOption,
    SpeedOption,
    StarDiameterOption,
    StarDistanceOption,
    StarOption,
    YesOption,
    existing,
)
from labapp.common.errors import UserError


@app.command()
def refine(
    design: Annotated[
        Path, typer.Argument(metavar="DESIGN.h5", help="A design that labapp retrieve wrote.")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="BETTER.h5", help="Where the refined design goes.")
    ] = None,
    bench: BenchOption = None,
    scene: SceneOption = None,
    pictures: Annotated[
        int, typer.Option(help="To take; the first shows the start, the last only judges.")
    ] = 5,
    exposures_ms: Annotated[
        str, typer.Option(metavar="MS,...", help="Of each picture; of a video whole periods.")
    ] = "1,8,64",
    star: StarOption = "star",
    dark: DarkOption = "dark",
    star_um: StarDiameterOption = None,
    star_m: StarDistanceOption = None,
    runs: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Where the records go.  [BETTER_runs, beside]"),
    ] = None,
    faults: FaultsOption = None,
    speed: SpeedOption = float("inf"),
    yes: YesOption = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Correct a retrieved pattern or video by pictures of its PSF.

    **labapp refine ring.h5 --out better.h5**

    shows the design on the bench, photographs the star through it, and asks for more light where
    the camera sees too little, picture by picture; **better.h5** is what the best picture showed,
    and **better_psf.png** what the camera saw before and after. What the camera's description and
    its calibration don't know is corrected too. Calibrate the bench first. Videos gain most.
    """
    if out is None:
        raise UserError("there is no --out. Name an .h5 file to write.")
    existing(design)
    one_thread()
    from labapp.bench.opening import BenchFiles
    from labapp.refining.command import refine_design
    from labapp.refining.request import Request, milliseconds
    from labapp.runs.running import Manner

    request = Request.of(
        pictures=pictures,
        exposures_ms=milliseconds(exposures_ms),
        star=star,
        dark=dark,
        star_um=star_um,
        star_m=star_m,
    )
    files = BenchFiles.default(bench, scene, None, faults)
    refine_design(design, out, runs, request, files, Manner(force, yes, speed, json))
