"""Commands for the bench itself: what is there, and its window."""

from __future__ import annotations

import typer

from labapp.cli.app import app
from labapp.cli.options import (
    BenchOption,
    FaultsOption,
    ImageOption,
    JsonOption,
    SceneOption,
)


@app.command()
def devices(bench: BenchOption = None, scene: SceneOption = None, json: JsonOption = False) -> None:
    """List the bench's devices, the installed drivers, and what is plugged in."""
    from labapp.listing import list_devices

    list_devices(bench, scene, as_json=json)


@app.command()
def gui(
    bench: BenchOption = None,
    scene: SceneOption = None,
    image: ImageOption = None,
    faults: FaultsOption = None,
) -> None:
    """Open the bench window; without options, on the bundled virtual bench."""
    from labapp.window.app import main as open_window

    raise typer.Exit(open_window(bench, scene, image, faults))
