"""The command `labapp calibrate`, which calibrates a bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import RunOptions, StarOptions, existing_path
from labapp.common.errors import UserError
from labapp.common.threads import use_one_thread


@app.command(cls=command_with_options(StarOptions(), RunOptions()))
def calibrate(
    context: typer.Context,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder for plan, record and results.")
    ] = None,
    wavelength_nm: Annotated[
        list[float] | None,
        typer.Option(
            metavar="NM",
            help="Wavelength in nanometres; repeat the option for more.  [532; with --spectra, the "
            "plan's bands]",
        ),
    ] = None,
    regions: Annotated[
        str | None,
        typer.Option(
            metavar="RxC",
            help="Rows x columns of panel regions, each with its own phase curve.",
            show_default="2x2",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART",
            help="Part to calibrate: registration, response, wavefront or zeroth; repeat the "
            "option for more.  [all]",
        ),
    ] = None,
    levels: Annotated[
        int | None,
        typer.Option(
            help="Number of grey levels, and of frames, for the phase response.", show_default="40"
        ),
    ] = None,
    exposure_ms: Annotated[
        float | None,
        typer.Option(
            help="Exposure time of the star with the neutral pattern, a little below clipping, in "
            "milliseconds.  [found by trial]"
        ),
    ] = None,
    spectra: Annotated[
        bool,
        typer.Option("--spectra", help="Calibrate PSFs and response of a snapshot's bands."),
    ] = False,
    plan: Annotated[
        str | None,
        typer.Option(
            metavar="PLAN",
            help="With --spectra, plan of the snapshots: its coded pattern is calibrated.",
            show_default="coded-snapshot",
        ),
    ] = None,
    flat: Annotated[
        str | None,
        typer.Option(
            metavar="TARGET",
            help="With --spectra, target that is a white sheet.",
            show_default="flat",
        ),
    ] = None,
    flat_ms: Annotated[
        float | None,
        typer.Option(
            help="With --spectra, exposure time of the white sheet, a little below clipping, in "
            "milliseconds.  [found by trial]"
        ),
    ] = None,
    lamp: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="With --spectra, spectrum of the lamp, for the filter's transmission: a CIE "
            "illuminant, such as A, or a CSV file of wavelengths in nm and power.",
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

    **--spectra** calibrates a camera for coded snapshots instead, whose sensor has colour filters:
    the PSF of each band (zeroth order, size, place) and what each filter sees of it, from the star
    through the coded pattern of **--plan** and from a white sheet, each with its uncertainty; and
    the light of each band, where the bench has a spectroradiometer. The folder gets
    **spectra.json** and **spectra.png** instead, for labapp reconstruct --calibration. For instance

    **labapp calibrate --spectra --bench colour.toml --out spectra --yes**
    """
    if fit is None and out is None:
        raise UserError("--out is missing: name a folder for plan, record and results.")
    spectra_only = {"--plan": plan, "--flat": flat, "--flat-ms": flat_ms, "--lamp": lamp}
    panel_only = {"--regions": regions, "--levels": levels, "--only": only}
    _require_options_of_one_kind(spectra, spectra_only, panel_only)
    if spectra:
        named: dict[str, Any] = {
            "plan": plan, "flat": flat or "flat", "flat_ms": flat_ms, "lamp": lamp,
            "wavelengths_nm": tuple(wavelength_nm or ()), "exposure_ms": exposure_ms,
        }  # fmt: skip
        _calibrate_spectra(context, named, out, fit, plan_only=plan_only)
        return
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
        regions=regions or "2x2",
        only=tuple(only or ()),
        levels=40 if levels is None else levels,
        exposure_ms=exposure_ms,
        **vars(get_option_group(context, StarOptions)),
    )
    take = write_plan_only if plan_only else calibrate_bench
    take(asked, out, options.bench_files(), options.run_mode)


def _calibrate_spectra(
    context: typer.Context,
    named: dict[str, Any],
    out: Path | None,
    fit: Path | None,
    *,
    plan_only: bool,
) -> None:
    """Calibrate a snapshot camera, as the command's options say."""
    use_one_thread()
    from labapp.spectral_calibration.command import (
        SpectraOptions,
        calibrate_spectra_of_bench,
        refit_spectra,
        write_spectra_plan,
    )

    options = get_option_group(context, RunOptions)
    if fit is not None:
        refit_spectra(fit, named["lamp"], options.run_mode)
        return
    assert out is not None
    asked = SpectraOptions(**named, **vars(get_option_group(context, StarOptions)))
    take = write_spectra_plan if plan_only else calibrate_spectra_of_bench
    take(asked, out, options.bench_files(), options.run_mode)


def _require_options_of_one_kind(
    spectra: bool, spectra_only: dict[str, Any], panel_only: dict[str, Any]
) -> None:
    """Raise UserError for options that mean nothing to the kind of calibration of the command."""
    refused = panel_only if spectra else spectra_only
    given = next((name for name, value in refused.items() if value is not None), None)
    if given is not None and spectra:
        raise UserError(f"{given}: means nothing with --spectra. Leave one of the two out.")
    if given is not None:
        raise UserError(
            f"{given}: means something with --spectra only. Add --spectra, or leave it out."
        )
