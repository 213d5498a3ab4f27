"""Training of what labapp computes with: `labapp train ...`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import ForceOption, SeedOption, require_one_length
from labapp.common.threads import use_one_thread

train_app = typer.Typer(
    help="Train on pictures what restores photographs; interrupted training goes on.",
    no_args_is_help=True,
)
app.add_typer(train_app, name="train")

DeviceOption = Annotated[
    str,
    typer.Option(
        metavar="auto|cpu|cuda",
        help="What to compute on: a GPU (cuda), the processor (cpu), or a GPU where there is one.",
    ),
]
MinutesOption = Annotated[
    float | None,
    typer.Option(
        min=0.01,
        help="Minutes that the training may take, instead of steps. They become a number of steps, "
        "once, which is printed and kept.",
        show_default=False,
    ),
]


@train_app.command()
def denoiser(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDER...", help="Folders of sharp pictures, or picture files."),
    ],
    out: Annotated[
        Path, typer.Option(metavar="WEIGHTS.npz", help="File of weights to write.")
    ] = Path("denoiser.npz"),
    steps: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Training steps, each with 16 patches of 64 x 64 pixels.",
            show_default="24000",
        ),
    ] = None,
    minutes: MinutesOption = None,
    seed: SeedOption = 1,
    device: DeviceOption = "auto",
    force: ForceOption = False,
) -> None:
    """Train the denoiser of plug-and-play restoration on the pictures in FOLDER.

    For instance

    **labapp train denoiser photographs/ --out denoiser.npz**

    24000 steps take two to three processor hours on one core. The state is kept beside the weights
    (WEIGHTS.training): an interrupted training goes on with the same command, and ends in the same
    weights. The same pictures, steps and seed give the same weights on the same machine.

    Several processes share the patches of each step, one for each core or GPU:

    **torchrun --nproc-per-node 2 -m labapp train denoiser photographs/ --out denoiser.npz**

    labapp/data/SOURCES.txt names the pictures of the bundled weights.
    """
    from labapp.files.output_paths import weights_output_path

    require_one_length(steps, minutes)
    place = weights_output_path(out, force=force)
    use_one_thread()
    from labapp.training.denoiser import train_denoiser

    train_denoiser(folders, place, steps=steps, minutes=minutes, seed=seed, device=device)


@train_app.command()
def edof(
    config: Annotated[
        Path | None,
        typer.Argument(
            metavar="CONFIG.toml",
            help="What is trained, on what scenes, and how; see labapp help depth-of-field.",
            show_default="the bundled pattern's",
        ),
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder of sharp photographs; may be repeated.",
            show_default="drawn pictures alone",
        ),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE.h5",
            help="Design file to write, with pattern and decoder; FILE.png, the pattern, "
            "FILE_training.png, scores and decoded scenes, and FILE_data.json, the list of the "
            "photographs, are written beside it.",
        ),
    ] = Path("edof.h5"),
    steps: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Training steps of decoder and pattern in all.",
            show_default="20000",
        ),
    ] = None,
    minutes: MinutesOption = None,
    test_pictures: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="PATH",
            help="Pictures, folders or fingerprints that the result will be tested on. Photographs "
            "that are alike are refused.",
            show_default="those of the project's own figures",
        ),
    ] = None,
    device: DeviceOption = "auto",
    force: ForceOption = False,
) -> None:
    """Train a pattern that extends the depth of field, together with its decoder.

    For instance

    **labapp train edof CONFIG.toml --data photographs/ --minutes 60 --out edof.h5**

    The pattern is designed without pictures first, then its decoder is trained on captures of
    photographs and of scenes with several layers, then both are trained together; that is kept only
    if validation improves. Without a configuration, that of the bundled pattern is taken. The state
    is kept beside the result: an interrupted training goes on with the same command, and ends in
    the same weights. **labapp reconstruct --decoder edof.h5** decodes photographs with the result.

    Several processes share the scenes of each step, one for each core or GPU:

    **torchrun --nproc-per-node 2 -m labapp train edof CONFIG.toml --data photographs/**
    """
    from labapp.files.output_paths import trained_output_paths

    require_one_length(steps, minutes)
    files = trained_output_paths(out, force=force)
    use_one_thread()
    from labapp.training.edof.command import TrainingRequest, train_edof
    from labapp.training.edof.config import BUNDLED_CONFIG, read_edof_config

    place = config or BUNDLED_CONFIG
    request = TrainingRequest(
        read_edof_config(place),
        place.parent,
        tuple(data or ()),
        tuple(test_pictures or ()),
        steps,
        minutes,
        device,
    )
    train_edof(request, files)
