"""The command that makes patterns from formulas."""

from __future__ import annotations

from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.groups import given, having
from labapp.cli.options import DesignOptions, KeysArgument


@app.command(cls=having(DesignOptions()))
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

    design = given(context, DesignOptions)
    if name == "list":
        list_patterns(as_json=design.json)
        return
    design.make(read_pattern(name, keys or [], design.wavelength_nm))
