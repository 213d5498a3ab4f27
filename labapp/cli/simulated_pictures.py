"""Commands of the virtual bench's pictures: what one calls for, and taking them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import (
    BenchOption,
    EffectOptions,
    ForceOption,
    JsonOption,
    PictureOptions,
)


@app.command(cls=command_with_options(PictureOptions(), EffectOptions()))
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
    from labapp.light.simulating.effect_explanation import explain_effects as explained

    asked = get_option_group(context, PictureOptions).picture_request(
        bench, get_option_group(context, EffectOptions)
    )
    if not explained(asked, with_audit=audit, pairs=pairs, as_json=json):
        raise typer.Exit(1)


@app.command(cls=command_with_options(PictureOptions(), EffectOptions()))
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
    from labapp.files.output_paths import frames_output_path

    place, kind = frames_output_path(out, frames, force=force)
    from labapp.light.simulating.simulated_frames import simulate_frames as simulated

    decided = get_option_group(context, EffectOptions)
    asked = get_option_group(context, PictureOptions).picture_request(
        bench, decided, everything=everything
    )
    simulated(asked, place, kind, frames=frames, seed=seed)
