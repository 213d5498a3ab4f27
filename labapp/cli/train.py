"""The command that trains the network behind plug-and-play restoration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import ForceOption
from labapp.common.threads import use_one_thread


@app.command()
def train(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDER...", help="Of sharp pictures, or pictures themselves."),
    ],
    out: Annotated[Path, typer.Option(metavar="WEIGHTS.npz", help="Where the weights go.")] = Path(
        "denoiser.npz"
    ),
    steps: Annotated[
        int, typer.Option(min=1, help="Of 16 patches of 64 x 64 pixels each.")
    ] = 24000,
    seed: Annotated[int, typer.Option(help="All chance comes from it.")] = 1,
    force: ForceOption = False,
) -> None:
    """Train the denoiser of plug-and-play restoration from pictures.

    **labapp train photographs/ --out denoiser.npz**

    The same pictures, steps and seed give the same weights on the same machine. 24000 steps take
    two to three processor hours on one core. What was learned so far is kept beside the weights
    every 200 steps: interrupt it when you like, and give the same command again to go on.
    The weights that come with the project were trained so; labapp/data/SOURCES.txt says on what.
    """
    from labapp.files.output_paths import weights_output_path

    place = weights_output_path(out, force=force)
    use_one_thread()
    from labapp.pictures.training.command import train_denoiser

    train_denoiser(folders, place, steps=steps, seed=seed)
