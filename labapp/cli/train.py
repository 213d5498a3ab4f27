"""The command `labapp train`, which trains the denoiser of plug-and-play restoration."""

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
        typer.Argument(metavar="FOLDER...", help="Folders of sharp pictures, or picture files."),
    ],
    out: Annotated[
        Path, typer.Option(metavar="WEIGHTS.npz", help="File of weights to write.")
    ] = Path("denoiser.npz"),
    steps: Annotated[
        int,
        typer.Option(min=1, help="Training steps, each with 16 patches of 64 x 64 pixels."),
    ] = 24000,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.")] = 1,
    force: ForceOption = False,
) -> None:
    """Train the denoiser of plug-and-play restoration on the pictures in FOLDER.

    For instance

    **labapp train photographs/ --out denoiser.npz**

    The same pictures, steps and seed give the same weights on the same machine. 24000 steps take
    two to three processor hours on one core. A checkpoint is written beside the weights every 200
    steps: you may interrupt the training, and continue it by the same command. The bundled weights
    were trained in this way; labapp/data/SOURCES.txt names the pictures.
    """
    from labapp.files.output_paths import weights_output_path

    place = weights_output_path(out, force=force)
    use_one_thread()
    from labapp.pictures.training.command import train_denoiser

    train_denoiser(folders, place, steps=steps, seed=seed)
