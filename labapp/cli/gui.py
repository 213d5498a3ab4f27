"""`labapp gui`, which opens the bench window."""

from __future__ import annotations

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import (
    BenchOption,
    FaultsOption,
    ImageOption,
    MemoryOption,
    SceneOption,
    memory_bytes,
)


@app.command()
def gui(
    bench: BenchOption = None,
    scene: SceneOption = None,
    image: ImageOption = None,
    faults: FaultsOption = None,
    memory: MemoryOption = None,
) -> None:
    """Open the window of a bench (--bench); without options, of the bundled virtual bench.

    For instance

    **labapp gui --bench bench.toml**
    """
    from labapp.window.app import main as open_window

    kept = memory_bytes(memory)
    raise typer.Exit(open_window(bench=bench, scene=scene, image=image, faults=faults, memory=kept))
