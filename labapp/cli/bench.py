"""`labapp bench ...`, which checks bench files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import JsonOption, SceneOption, readable_path

bench = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
app.add_typer(bench, name="bench")


@bench.callback()
def bench_() -> None:
    """Check bench files on the command line before they are used."""


@bench.command("check")
def bench_check_(
    bench: Annotated[
        Path, typer.Argument(metavar="BENCH.toml", callback=readable_path, help="Bench file.")
    ],
    scene: SceneOption = None,
    opening: Annotated[
        bool, typer.Option("--open/--no-open", help="Open each device as well.")
    ] = True,
    json: JsonOption = False,
) -> None:
    """Check that BENCH.toml is right and its devices are there, and open each (unless --no-open).

    Each device is opened alone, so that a missing one doesn't prevent the check of the others. The
    exit code is 1 if anything is wrong. For instance

    **labapp bench check bench.toml**
    """
    from labapp.bench.bench_check import check_bench

    if not check_bench(bench, scene, open_devices=opening, as_json=json):
        raise typer.Exit(1)
