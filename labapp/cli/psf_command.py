"""The command that computes a PSF."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.lens_options import CameraOptions, LensOptions, build_lens_case
from labapp.cli.option_groups import command_with_options
from labapp.cli.shared_options import FieldOption, ForceOption, JsonOption, readable_path
from labapp.common.threads import use_one_thread


@app.command(cls=command_with_options(CameraOptions(), LensOptions(), options_first=True))
def psf(
    context: typer.Context,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help=".npy, .tiff (float) or .png to write.")
    ],
    tol: Annotated[
        float, typer.Option(help="Relative L2 error of sampling and arithmetic to keep.")
    ] = 1e-3,
    points: Annotated[
        bool, typer.Option("--points", help="Light at pixel centres, not on whole pixels.")
    ] = False,
    method: Annotated[
        str | None,
        typer.Option(
            help="Of a lens: axial, scattered or sampled. Of a camera: a transform, or where the "
            "panel stands apart, collapsed or chain. None: the cheapest that keeps tol."
        ),
    ] = None,
    memory_mb: Annotated[int, typer.Option(help="Megabytes that may be used.")] = 4000,
    pattern: Annotated[
        Path | None,
        typer.Option(
            callback=readable_path,
            help="8-bit picture on the SLM before the lens; none: a neutral one.",
        ),
    ] = None,
    field: FieldOption = "0,0",
    sphere: Annotated[
        bool, typer.Option("--sphere", help="The object's wave is a sphere, not a parabola.")
    ] = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Compute a PSF to a tolerance, and say what it cost and how far it can be trusted.

    Without a camera or a pattern: a lens with its stop. With a camera's file: its panel and,
    a separation behind it, its lens; the options of the lens count more than the file. With a
    pattern alone: the lens behind the panel of the virtual bench. Values are shares of the
    light, one a pixel; a picture of five decades is written beside the data.
    """
    from labapp.files.output_paths import psf_output_paths
    from labapp.light.lens_options import read_field

    off_axis, places = read_field(field), psf_output_paths(out, force=force)
    use_one_thread()
    described = build_lens_case(context)
    from labapp.light.psf_prediction import PSFRequest, predict_psf

    memory = memory_mb * 1_000_000
    asked = PSFRequest(described, tol, points, method, memory, pattern, off_axis, sphere)
    predict_psf(asked, *places, as_json=json)
