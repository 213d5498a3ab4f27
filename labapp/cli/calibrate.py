"""The command that calibrates a bench."""

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
        Path | None, typer.Option(metavar="FOLDER", help="Where plan, record and results go.")
    ] = None,
    wavelength_nm: Annotated[
        list[float] | None,
        typer.Option(metavar="NM", help="At which to calibrate; several times for several.  [532]"),
    ] = None,
    regions: Annotated[
        str, typer.Option(metavar="RxC", help="Of the panel, each with a curve of its own.")
    ] = "2x2",
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART",
            help="registration, response, wavefront or zeroth; several times for several.  [all]",
        ),
    ] = None,
    levels: Annotated[int, typer.Option(help="Frames of the sweep of grey levels.")] = 40,
    exposure_ms: Annotated[
        float | None,
        typer.Option(help="Of the neutral star, a little below clipping.  [found by trial]"),
    ] = None,
    plan_only: Annotated[
        bool, typer.Option("--plan-only", help="Write plan and patterns, take no pictures.")
    ] = False,
    fit: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN.h5",
            callback=existing_path,
            help="Fit a record that is there; take no pictures.",
        ),
    ] = None,
) -> None:
    """Find out what panel, lens and sensor really do, with an artificial star.

    Takes up to 60 frames for one wavelength, fits them, and writes **plan.toml**, **patterns/**,
    **run.h5**, **calibration.json** and **calibration.png** to a folder: where gratings send
    light on the sensor, the phase of every grey level, wavefront and focus, and the light that no
    pattern moves, each with residual and uncertainty. A line in the bench file,
    `calibration = "calibration.json"`, puts it in force.
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
