"""Calibrations of a bench, of its camera alone, or of a snapshot's bands: `labapp calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import (
    RunOptions,
    StarOptions,
    existing_path,
    light_option,
    require_options_of_kind,
)
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
        light_option(
            "Wavelength in nanometres; repeat the option for more.  [532; with --spectra, the "
            "plan's bands]",
            metavar="NM",
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
            help="With --spectra, target that is a white sheet; with --camera, one that is evenly "
            "lit.",
            show_default="flat",
        ),
    ] = None,
    flat_ms: Annotated[
        float | None,
        typer.Option(
            help="With --spectra, exposure time of the white sheet, a little below clipping; with "
            "--camera, longest exposure time, a quarter more than fills the pixels; in "
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
    camera: Annotated[
        bool,
        typer.Option(
            "--camera", help="Calibrate gain, noise, saturation and defects of the camera alone."
        ),
    ] = False,
    exposures: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="With --camera, number of exposure times.", show_default="50"
        ),
    ] = None,
    dark_s: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="With --camera, longest exposure time of darkness in seconds.",
            show_default="2",
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

    **--camera** calibrates the camera alone, by photon transfer (EMVA 1288): pairs of frames of an
    evenly lit target (**--flat**) and of darkness (**--dark**), from darkness to saturation. It
    measures gain, read noise, full well, linearity, PRNU, DSNU and dark current, each with its
    uncertainty, and lists hot and dead pixels. The light may be of any strength and needn't be
    quite even, but it shouldn't move; a texture should be out of focus. The folder gets
    **camera.json** and **camera.png** instead; add the line `camera_calibration = "camera.json"`
    to the bench file, and merges, reports and restorations use what was measured. **--fit** takes
    a record of the ready plan photon-transfer, too. For instance

    **labapp calibrate --camera --out camera --yes**
    """
    if fit is None and out is None:
        raise UserError("--out is missing: name a folder for plan, record and results.")
    require_options_of_kind(
        "--camera" if camera else "--spectra" if spectra else "",
        {
            ("--spectra",): {"--spectra": spectra or None, "--plan": plan, "--lamp": lamp},
            ("--spectra", "--camera"): {"--flat": flat, "--flat-ms": flat_ms},
            ("--camera",): {"--exposures": exposures, "--dark-s": dark_s},
            ("",): {"--regions": regions, "--levels": levels, "--only": only},
            ("", "--spectra"): {"--exposure-ms": exposure_ms},
        },
    )
    if spectra:
        named: dict[str, Any] = {
            "plan": plan, "flat": flat or "flat", "flat_ms": flat_ms, "lamp": lamp,
            "wavelengths_nm": tuple(wavelength_nm or ()), "exposure_ms": exposure_ms,
        }  # fmt: skip
        _calibrate_spectra(context, named, out, fit, plan_only=plan_only)
        return
    if camera:
        use_one_thread()
    from labapp.calibration.command import CAMERA, PANEL

    options = get_option_group(context, RunOptions)
    kind = CAMERA if camera else PANEL
    if fit is not None:
        kind.refit(fit, options.run_mode, **({"flat": flat} if camera else {}))
        return
    assert out is not None
    star = get_option_group(context, StarOptions)
    asked: dict[str, Any]
    if camera:
        if len(wavelength_nm or ()) > 1:
            raise UserError("--wavelength-nm: the camera is calibrated at one wavelength.")
        asked = {
            "flat": flat, "dark": star.dark, "wavelength_nm": next(iter(wavelength_nm or ()), None),
            "exposures": exposures, "flat_ms": flat_ms, "dark_s": dark_s,
        }  # fmt: skip
    else:
        from labapp.calibration.request import parse_regions

        asked = {
            "wavelengths_nm": sorted(set(wavelength_nm or [532.0])),
            "regions": None if regions is None else parse_regions(regions),
            "parts": tuple(only or ()) or None, "levels": levels, "exposure_ms": exposure_ms,
            "star": star.star, "dark": star.dark,
            "star_diameter_um": star.star_um, "star_distance_m": star.star_m,
        }  # fmt: skip
    take = kind.write_plan if plan_only else kind.take_and_fit
    take(kind.read_request(asked), out, options.bench_files(), options.run_mode)


def _calibrate_spectra(
    context: typer.Context,
    named: dict[str, Any],
    out: Path | None,
    fit: Path | None,
    *,
    plan_only: bool,
) -> None:
    """Calibrate a snapshot camera, from a bench or from the record `fit`."""
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
