"""`labapp design ...`, which searches for patterns by their expected restoration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import BenchOption, ForceOption, JsonOption, light_in_nanometres
from labapp.common.errors import UserError
from labapp.common.threads import use_one_thread

design_app = typer.Typer(
    help="Search for the pattern from whose photographs restoration gets most.",
    no_args_is_help=True,
)
app.add_typer(design_app, name="design")


@design_app.command()
def edof(
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE.h5",
            help="Design file to write; FILE.png, the pattern, and FILE_design.png, its picture, "
            "are written beside it.",
        ),
    ],
    near_dioptre: Annotated[
        float, typer.Option(metavar="D", help="Nearest depth, in dioptres from the panel.")
    ] = 2.0,
    far_dioptre: Annotated[
        float, typer.Option(metavar="D", help="Farthest depth, in dioptres; 0 is infinity.")
    ] = 0.0,
    wavelength_nm: Annotated[
        list[float] | None,
        typer.Option(
            callback=light_in_nanometres,
            help="Wavelength in nanometres. Several (the option repeated) make one pattern for "
            "all, shown for the first one; the panel's dispersion counts.",
            show_default="520",
        ),
    ] = None,
    noise: Annotated[
        float, typer.Option(help="Standard deviation of a pixel's noise, where white is 1.")
    ] = 0.008,
    decoder: Annotated[
        str,
        typer.Option(
            help="What restores the photographs: blind (one filter for all depths) or known (the "
            "depth is known). The best patterns of the two differ."
        ),
    ] = "blind",
    pictures: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            exists=True,
            file_okay=False,
            help="Photographs whose power spectrum is designed for.",
            show_default="natural photographs",
        ),
    ] = None,
    start: Annotated[
        str,
        typer.Option(
            help="Pattern to start from: rings, sweep, lattice, cubic, flat, or a design file. It "
            "decides more than many steps: rings or sweep for blind, cubic or lattice for known.",
            show_default="rings, or cubic for known",
        ),
    ] = "",
    parameters: Annotated[
        str,
        typer.Option(
            help="How the pattern is described: quarter (mirrored), radial, free, separable or "
            "separable-mirrored.",
            show_default="quarter, or free for known",
        ),
    ] = "",
    minutes: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            help="Minutes that the search may take. They become a number of steps, once, which is "
            "printed.",
            show_default="2",
        ),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Steps of the search, instead of minutes.")
    ] = None,
    size: Annotated[
        int, typer.Option(min=32, max=2048, help="Pixels along a side of the periodic pictures.")
    ] = 512,
    orders: Annotated[
        int, typer.Option(min=1, help="Whole waves of the panel's range that the pattern uses.")
    ] = 1,
    fringing_um: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Fringing that the pattern shall stand: micrometres (standard deviation) by which "
            "neighbouring pixels of the panel blur its phase. Jumps where the phase is wrapped "
            "suffer most, so the search then moves the phase as it is displayed. labapp calibrate "
            "measures it; 0 for a panel without.",
            show_default="the bench's",
        ),
    ] = None,
    response_error: Annotated[
        float,
        typer.Option(
            metavar="E",
            help="Error of the panel's response that the pattern shall stand, as a share of its "
            "phase, to both sides: .05 for a look-up table that is known to 5 %.",
        ),
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 1,
    bench: BenchOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Design a pattern that extends the depth of field, and print what it gives beside the bound.

    For instance

    **labapp design edof --minutes 2 --out edof.h5**

    No pictures are needed: the pattern is judged by the error that linear restoration is expected
    to leave, over all depths of the range. No pattern can pass the bound that is printed with it.
    An interrupted design goes on with the same command.
    """
    from labapp.edof.design_request import EdofRequest
    from labapp.files.output_paths import edof_output_paths

    if minutes is not None and steps is not None:
        raise UserError("--minutes and --steps: give one of them.")
    known = decoder == "known"
    request = EdofRequest(
        bench,
        tuple(one * 1e-9 for one in wavelength_nm or [520.0]),
        near_dioptre,
        far_dioptre,
        noise,
        decoder,  # type: ignore[arg-type]
        pictures,
        start or ("cubic" if known else "rings"),
        parameters or ("free" if known else "quarter"),
        size,
        orders,
        seed,
        fringing=None if fringing_um is None else fringing_um * 1e-6,
        response_error=response_error,
    )
    files = edof_output_paths(out, force=force)
    use_one_thread()
    from labapp.edof.command import design_edof

    design_edof(request, files, steps=steps, minutes=minutes or 2.0, as_json=json)
