"""The command that finds patterns from the PSF that they shall give."""

from __future__ import annotations

from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.groups import given, having
from labapp.cli.options import DesignOptions, KeysArgument


@app.command(cls=having(DesignOptions()))
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

    design = given(context, DesignOptions)
    if target == "list":
        list_targets(as_json=design.json)
        return
    options = {"budget_s": budget, "iterations": iterations, "method": method}
    design.make(read_psf(target, keys or [], design.wavelength_nm, options))
