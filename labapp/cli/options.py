"""Options and arguments that several commands take.

Files that aren't there are refused as the command line is read, before anything is loaded.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def readable(path: Path | None) -> Path | None:
    """The path, or None; UserError if it can't be opened."""
    from labapp.files.finding import require_readable

    if path is not None:
        require_readable(path)
    return path


def existing(path: Path | None) -> Path | None:
    """The path, or None; UserError if there is no such file."""
    from labapp.files.finding import require_file

    if path is not None:
        require_file(path)
    return path


def scene_of(name: Path | None) -> Path | None:
    """The file of a scene, or None; UserError lists the bundled ones."""
    from labapp.files.finding import find_scene

    return None if name is None else find_scene(name)


BenchOption = Annotated[
    Path | None,
    typer.Option(
        "--bench",
        callback=readable,
        help="Bench file (TOML). Default: the bundled virtual bench.",
    ),
]
SceneOption = Annotated[
    Path | None,
    typer.Option(
        "--scene",
        callback=scene_of,
        help="Scene for simulated devices: a file (TOML), or the name of a bundled one, as bricks.",
    ),
]
ImageOption = Annotated[
    Path | None,
    typer.Option(
        "--image",
        callback=readable,
        help="Your photograph (JPEG, PNG, TIFF) for the simulated scene.",
    ),
]
FaultsOption = Annotated[
    Path | None,
    typer.Option(
        "--faults",
        callback=readable,
        help="Fault file (TOML): what simulated devices shall suffer.",
    ),
]
SpeedOption = Annotated[
    float,
    typer.Option(
        help="Seconds of a virtual bench's time in a second; 1 is real time.",
        show_default="as fast as the computer",
    ),
]
YesOption = Annotated[bool, typer.Option("--yes", help="All targets are in place: ask nobody.")]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace existing output files.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print figures as JSON.")]
PlotOption = Annotated[
    Path | None,
    typer.Option("--plot", metavar="FILE", help="Draw the rows against time (.png, .svg)."),
]
StarOption = Annotated[str, typer.Option("--star", help="The target with the star.")]
DarkOption = Annotated[str, typer.Option("--dark", help="The target without light; '' for none.")]
StarDiameterOption = Annotated[
    float | None,
    typer.Option("--star-um", help="Diameter of the pinhole.", show_default="the scene's"),
]
StarDistanceOption = Annotated[
    float | None,
    typer.Option(
        "--star-m", help="Distance of the pinhole.", show_default="the scene's, or in focus"
    ),
]
RecordArgument = Annotated[
    Path, typer.Argument(metavar="RUN.h5", callback=existing, help="Record of a run.")
]
PeersOption = Annotated[
    bool,
    typer.Option("--peers", help="Also other libraries, by installed adapters (tests/peers)."),
]
