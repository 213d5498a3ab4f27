"""Patterns for the SLM, by formulas and phase retrieval: `labapp pattern`, `labapp retrieve`."""

from __future__ import annotations

from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import DesignOptions, KeysArgument


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
