"""Patterns for the SLM: by formulas, phase retrieval and search, and corrected by pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import (
    BenchOption,
    DesignOptions,
    ForceOption,
    JsonOption,
    KeysArgument,
    PixelNoiseOption,
    RunOptions,
    SeedOption,
    StarOptions,
    existing_path,
    light_option,
    require_one_length,
)
from labapp.common.errors import UserError
from labapp.common.threads import use_one_thread


@app.command(cls=command_with_options(DesignOptions()))
def pattern(
    context: typer.Context,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Kind of pattern, or 'list'.")],
    keys: KeysArgument = None,
) -> None:
    """Compute an SLM pattern from a formula and KEY=VALUE arguments, and predict its PSF.

    **labapp pattern list** gives the kinds with their keys and units: formulas such as lenses,
    gratings and masks for depth of field, sums, shapes, pictures. For instance

    **labapp pattern lens focal_length_m=20 --out lens.png**

    writes the grey levels of the panel to lens.png, and the predicted PSF to lens_psf.png. A
    pattern whose phase is steeper than the pixels allow is refused, and the limit is given.
    """
    from labapp.patterns.designing.kinds import list_patterns, read_pattern

    design = get_option_group(context, DesignOptions)
    if name == "list":
        list_patterns(as_json=design.json)
        return
    design.design_and_write(read_pattern(name, keys or [], design.wavelength_nm))


@app.command(cls=command_with_options(DesignOptions()))
def retrieve(
    context: typer.Context,
    target: Annotated[str, typer.Argument(metavar="TARGET", help="Shape of the PSF, or 'list'.")],
    keys: KeysArgument = None,
    budget: Annotated[
        float | None,
        typer.Option(metavar="S", help="Processor seconds to spend; more give a better PSF."),
    ] = None,
    iterations: Annotated[
        int | None, typer.Option(min=1, help="Number of iterations, instead of a budget.")
    ] = None,
    method: Annotated[
        str | None, typer.Option(help="Method of phase retrieval. Default: the most suitable.")
    ] = None,
) -> None:
    """Find a pattern, or a video of patterns (--frames), whose PSF has the shape TARGET.

    **labapp retrieve list** gives the shapes with their keys: rings, spirals, dots, letters,
    a logo from a picture. For instance

    **labapp retrieve letters text=EI --frames 8 --out letters.h5**

    The frames of a video are computed together, so that the mean of their PSFs has the shape with
    hardly any speckle. Retrieval has no exact answer; the quality of the result is printed.
    """
    from labapp.patterns.designing.kinds import list_targets, read_psf

    design = get_option_group(context, DesignOptions)
    if target == "list":
        list_targets(as_json=design.json)
        return
    options = {"budget_s": budget, "iterations": iterations, "method": method}
    design.design_and_write(read_psf(target, keys or [], design.wavelength_nm, options))


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
        light_option(
            "Wavelength in nanometres. Several (the option repeated) make one pattern for "
            "all, shown for the first one; the panel's dispersion counts.",
            show_default="520",
        ),
    ] = None,
    noise: PixelNoiseOption = 0.008,
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
    seed: SeedOption = 1,
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

    require_one_length(steps, minutes)
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
