"""Pictures of the virtual bench without a run: `labapp explain` and `labapp simulate`."""

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
        bool,
        typer.Option(help="Render again with each omitted effect, and compare its error."),
    ] = False,
    check: Annotated[
        bool,
        typer.Option(help="Render the picture's middle again with everything on, and compare."),
    ] = False,
    pairs: Annotated[
        int, typer.Option(help="Number of pairs of effects that --audit adds together.")
    ] = 10,
    json: JsonOption = False,
) -> None:
    """Explain which effects a simulated picture of SCENE.toml needs, at which level, and why.

    For each effect the command prints the level at which it is computed, the error that this
    leaves, and the physics in a sentence. The sum of all errors stays within the tolerance. The
    exit code is 1 if **--audit** finds an error beyond what was told, or **--check** finds the
    picture's middle beyond the tolerance. For instance

    **labapp explain bricks --tol 1e-3 --audit**
    """
    from labapp.prediction.simulating.effect_explanation import explain_effects as explained

    asked = get_option_group(context, PictureOptions).picture_request(
        bench, get_option_group(context, EffectOptions)
    )
    if not explained(asked, with_audit=audit, pairs=pairs, as_json=json, with_check=check):
        raise typer.Exit(1)


@app.command(cls=command_with_options(PictureOptions(), EffectOptions()))
def simulate(
    context: typer.Context,
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write: .h5, .tiff or .png.")],
    bench: BenchOption = None,
    frames: Annotated[int, typer.Option(help="Number of frames; noise differs in each.")] = 1,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    everything: Annotated[
        bool,
        typer.Option(help="Compute all effects at their finest, whatever the tolerance."),
    ] = False,
    force: ForceOption = False,
) -> None:
    """Simulate pictures of SCENE.toml on the virtual bench, without a run, and write them to --out.

    Files hold raw digital numbers without scaling, so that pictures of a 12-bit camera look dark in
    a viewer that takes them for 16 bits. **.h5** also holds the mean picture, the variance, and the
    decisions about effects. For instance

    **labapp simulate star --set diffraction=rays --out rays.tiff**
    """
    from labapp.files.output_paths import frames_output_path

    place, kind = frames_output_path(out, frames, force=force)
    from labapp.prediction.simulating.simulated_frames import simulate_frames as simulated

    decided = get_option_group(context, EffectOptions)
    asked = get_option_group(context, PictureOptions).picture_request(
        bench, decided, everything=everything
    )
    simulated(asked, place, kind, frames=frames, seed=seed)
