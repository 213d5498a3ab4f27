"""`labapp psf`, the PSF to a tolerance, and `labapp beam`, the light along the optical axis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.lens_options import CameraOptions, LensOptions, build_lens_case
from labapp.cli.option_groups import command_with_options
from labapp.cli.shared_options import (
    CameraOption,
    FieldOption,
    ForceOption,
    JsonOption,
    NeutralPatternOption,
    SphereOption,
    WavelengthOption,
    file_option,
)
from labapp.common.threads import use_one_thread


@app.command(cls=command_with_options(CameraOptions(), LensOptions(), options_first=True))
def psf(
    context: typer.Context,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="File to write: .npy, .tiff (float) or .png.")
    ],
    tol: Annotated[
        float, typer.Option(help="Largest relative L2 error of sampling and arithmetic.")
    ] = 1e-3,
    points: Annotated[
        bool,
        typer.Option("--points", help="Compute the light at pixel centres, not over whole pixels."),
    ] = False,
    method: Annotated[
        str | None,
        typer.Option(
            help="For a lens: axial, scattered or sampled. For a camera: a Fourier transform, or "
            "collapsed or chain if the panel stands apart from the lens. Default: the cheapest "
            "that keeps --tol."
        ),
    ] = None,
    memory_mb: Annotated[int, typer.Option(help="Memory that may be used, in megabytes.")] = 4000,
    budget: Annotated[
        float, typer.Option(min=0, help="Seconds of processor time that may be used.")
    ] = 10.0,
    pattern: Annotated[
        Path | None,
        file_option("Pattern on the SLM in front of the lens, an 8-bit picture. Default: neutral."),
    ] = None,
    field: FieldOption = "0,0",
    sphere: SphereOption = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Compute a PSF to a tolerance (--tol), and report its cost and its error.

    Without --camera and --pattern, the command computes the PSF of a lens with its stop. With
    --camera, panel and lens come from the file; options of the lens override the file. With
    --pattern alone, the lens is behind the panel of the virtual bench. Each value is the share of
    the light on a pixel. A picture over five decades is written beside the data. For instance

    **labapp psf --focal-length 0.1 --f-number 5.6 --distance 2 --tol 1e-6 --out psf.npy**
    """
    from labapp.files.output_paths import psf_output_paths
    from labapp.prediction.lens_options import read_field

    off_axis, places = read_field(field), psf_output_paths(out, force=force)
    use_one_thread()
    described = build_lens_case(context)
    from labapp.prediction.psf_prediction import PSFRequest, predict_psf

    memory = memory_mb * 1_000_000
    asked = PSFRequest(described, tol, points, method, memory, pattern, off_axis, sphere, budget)
    predict_psf(asked, *places, as_json=json)


@app.command()
def beam(
    out: Annotated[Path, typer.Option(metavar="FILE", help="Picture to write (.png).")],
    camera: CameraOption = None,
    pattern: NeutralPatternOption = None,
    distance: Annotated[
        float,
        typer.Option(help="Distance of the object from the panel, in metres; inf is allowed."),
    ] = 2.0,
    wavelength_nm: WavelengthOption = 550.0,
    field: FieldOption = "0,0",
    slices: Annotated[
        int, typer.Option(help="Number of depths in each of the two pictures.")
    ] = 120,
    force: ForceOption = False,
) -> None:
    """Draw the light of a point along the axis, from the panel to the sensor, in a picture (--out).

    The file shows two pictures over four decades: the whole way from the panel through the lens to
    the sensor, and the light around the sensor. They show what the stop cuts off, where the
    diffraction orders of a pattern go, and how deep the focus is. For instance

    **labapp beam --distance 2 --out beam.png**
    """
    from labapp.files.output_paths import beam_output_path
    from labapp.prediction.lens_options import read_field

    off_axis, place = read_field(field), beam_output_path(out, force=force)
    from labapp.files.bench_file import read_camera
    from labapp.prediction.beam_picture import BeamRequest, draw_beam

    asked = BeamRequest(
        read_camera(camera), pattern, distance, wavelength_nm * 1e-9, off_axis, slices
    )
    draw_beam(asked, place)
