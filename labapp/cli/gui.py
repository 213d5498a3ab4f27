"""The command that opens the window."""

from __future__ import annotations

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import BenchOption, FaultsOption, ImageOption, SceneOption


@app.command()
def gui(
    bench: BenchOption = None,
    scene: SceneOption = None,
    image: ImageOption = None,
    faults: FaultsOption = None,
) -> None:
    """Open the bench window; without options, on the bundled virtual bench."""
    from labapp.window.app import main as open_window

    raise typer.Exit(open_window(bench=bench, scene=scene, image=image, faults=faults))
