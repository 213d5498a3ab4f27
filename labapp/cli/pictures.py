"""Commands of the virtual bench's pictures: what one calls for, and taking them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.groups import given, having
from labapp.cli.options import BenchOption, DecisionOptions, ForceOption, JsonOption, PictureOptions


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


@app.command(cls=having(PictureOptions(), DecisionOptions()))
def simulate(
    context: typer.Context,
    out: Annotated[Path, typer.Option(metavar="FILE", help="To write: .h5, .tiff or .png.")],
    bench: BenchOption = None,
    frames: Annotated[int, typer.Option(help="Number of frames; noise differs in each.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    everything: Annotated[
        bool, typer.Option(help="All effects at their finest, whatever the tolerance.")
    ] = False,
    force: ForceOption = False,
) -> None:
    """Take pictures of a scene with the virtual bench, without a run.

    Files hold raw digital numbers, not stretched: pictures of a 12-bit camera look dark in a
    viewer that takes them for 16 bits. **.h5** holds the mean picture and the variance as well,
    and what was decided.
    """
    from labapp.files.places import place_of_frames

    place, kind = place_of_frames(out, frames, force=force)
    from labapp.light.simulating.picturing import simulate as simulated

    decided = given(context, DecisionOptions)
    asked = given(context, PictureOptions).asked(bench, decided, everything=everything)
    simulated(asked, place, kind, frames=frames, seed=seed)
