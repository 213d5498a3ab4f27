"""The command that says what a simulated picture calls for."""

from __future__ import annotations

from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.groups import given, having
from labapp.cli.options import BenchOption, DecisionOptions, JsonOption, PictureOptions


@app.command(cls=having(PictureOptions(), DecisionOptions()))
def explain(
    context: typer.Context,
    bench: BenchOption = None,
    audit: Annotated[
        bool, typer.Option(help="Put back what is left out, and check it against its bound.")
    ] = False,
    pairs: Annotated[int, typer.Option(help="Pairs of effects that --audit puts back.")] = 10,
    json: JsonOption = False,
) -> None:
    """Say which effects a picture of a scene calls for, how far, and why.

    Each effect is named with the level at which it is computed, the most that it may change
    beyond that, and the physics in a sentence. The sum of all bounds stays within the
    tolerance. The exit code is 1 if **--audit** finds a bound broken.
    """
    from labapp.light.simulating.explaining import explain as explained

    asked = given(context, PictureOptions).asked(bench, given(context, DecisionOptions))
    if not explained(asked, audited=audit, pairs=pairs, as_json=json):
        raise typer.Exit(1)
