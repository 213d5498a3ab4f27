"""Commands that make patterns: from formulas, and from the PSF that they shall give."""

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
    """Make a pattern for the SLM, and a picture of the PSF that it will give.

    **labapp pattern list** tells the kinds with their keys: formulas such as lenses, gratings
    and masks for depth of field, sums, shapes, pictures. For instance

    **labapp pattern lens focal_length_m=20 --out lens.png**

    writes lens.png, grey levels of the panel's size, and lens_psf.png. A pattern that is steeper
    than the pixels allow is refused, with the limit.
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
        float | None, typer.Option(metavar="S", help="Processor seconds to spend; more is better.")
    ] = None,
    iterations: Annotated[int | None, typer.Option(min=1, help="Instead of a budget.")] = None,
    method: Annotated[
        str | None, typer.Option(help="Of retrieval; none: what serves best.")
    ] = None,
) -> None:
    """Find a pattern, or a video, whose PSF has the shape of a target.

    **labapp retrieve list** tells the shapes with their keys: rings, spirals, dots, letters,
    a logo from a picture. For instance

    **labapp retrieve letters text=EI --frames 8 --out letters.h5**

    The frames of a video know of each other: their mean has the shape, with hardly any speckle.
    There is no right answer: the quality reached is measured and printed.
    """
    from labapp.patterns.designing.kinds import list_targets, read_psf

    design = get_option_group(context, DesignOptions)
    if target == "list":
        list_targets(as_json=design.json)
        return
    options = {"budget_s": budget, "iterations": iterations, "method": method}
    design.design_and_write(read_psf(target, keys or [], design.wavelength_nm, options))
