"""The command `labapp calibrate`, which calibrates a bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import RunOptions, StarOptions, existing_path
from labapp.common.errors import UserError


@app.command(cls=command_with_options(StarOptions(), RunOptions()))
def calibrate(
    context: typer.Context,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder for plan, record and results.")
    ] = None,
    wavelength_nm: Annotated[
        list[float] | None,
        typer.Option(
            metavar="NM", help="Wavelength in nanometres; repeat the option for more.  [532]"
        ),
    ] = None,
    regions: Annotated[
        str,
        typer.Option(
            metavar="RxC", help="Rows x columns of panel regions, each with its own phase curve."
        ),
    ] = "2x2",
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART",
            help="Part to calibrate: registration, response, wavefront or zeroth; repeat the "
            "option for more.  [all]",
        ),
    ] = None,
    levels: Annotated[
        int, typer.Option(help="Number of grey levels, and of frames, for the phase response.")
    ] = 40,
    exposure_ms: Annotated[
        float | None,
        typer.Option(
            help="Exposure time of the star with the neutral pattern, a little below clipping, in "
            "milliseconds.  [found by trial]"
        ),
    ] = None,
    plan_only: Annotated[
        bool, typer.Option("--plan-only", help="Write plan and patterns, but take no pictures.")
    ] = False,
    fit: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN.h5",
            callback=existing_path,
            help="Fit an existing record instead of taking pictures.",
        ),
    ] = None,
) -> None:
    """Calibrate the panel, lens and sensor of a bench (--bench) with an artificial star.

    The command measures the registration (where gratings send light on the sensor), the phase of
    every grey level, the wavefront with its focus, and the zeroth order, each with residual and
    uncertainty. This takes up to 60 frames per wavelength. The folder gets **plan.toml**,
    **patterns/**, **run.h5**, **calibration.json** and **calibration.png**. To use the calibration,
    add the line `calibration = "calibration.json"` to the bench file. For instance

    **labapp calibrate --out calibration --regions 1x1 --levels 16 --yes**
    """
    if fit is None and out is None:
        raise UserError("--out is missing: name a folder for plan, record and results.")
    from labapp.calibration.command import (
        CalibrateOptions,
        calibrate_bench,
        refit_record,
        write_plan_only,
    )

    options = get_option_group(context, RunOptions)
    if fit is not None:
        refit_record(fit, options.run_mode)
        return
    assert out is not None
    asked = CalibrateOptions(
        wavelengths_nm=tuple(wavelength_nm or [532.0]),
        regions=regions,
        only=tuple(only or ()),
        levels=levels,
        exposure_ms=exposure_ms,
        **vars(get_option_group(context, StarOptions)),
    )
    take = write_plan_only if plan_only else calibrate_bench
    take(asked, out, options.bench_files(), options.run_mode)
