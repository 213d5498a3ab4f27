"""The command that takes pictures with the virtual bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.groups import given, having
from labapp.cli.options import BenchOption, DecisionOptions, ForceOption, PictureOptions


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
