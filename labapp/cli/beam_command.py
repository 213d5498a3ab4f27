"""`labapp beam`, which draws the light along the optical axis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import (
    CameraOption,
    FieldOption,
    ForceOption,
    light_in_nanometres,
    readable_path,
)


@app.command()
def beam(
    out: Annotated[Path, typer.Option(metavar="FILE", help="Picture to write (.png).")],
    camera: CameraOption = None,
    pattern: Annotated[
        Path | None,
        typer.Option(
            callback=readable_path,
            help="Pattern on the panel, an 8-bit picture. Default: neutral.",
        ),
    ] = None,
    distance: Annotated[
        float,
        typer.Option(help="Distance of the object from the panel, in metres; inf is allowed."),
    ] = 2.0,
    wavelength_nm: Annotated[
        float, typer.Option(callback=light_in_nanometres, help="Wavelength in nanometres.")
    ] = 550.0,
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
