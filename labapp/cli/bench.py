"""Commands for bench files."""

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
    """Look at bench files before they are used."""


@bench.command("check")
def bench_check_(
    bench: Annotated[
        Path, typer.Argument(metavar="BENCH.toml", callback=readable_path, help="Bench file.")
    ],
    scene: SceneOption = None,
    opening: Annotated[
        bool, typer.Option("--open/--no-open", help="Open each device, too.")
    ] = True,
    json: JsonOption = False,
) -> None:
    """Is a bench file right, and is everything there that it names?

    Each device by itself, so that one that is missing hides no other. Exit code 1 if anything
    is wrong.
    """
    from labapp.bench.bench_check import check_bench

    if not check_bench(bench, scene, open_devices=opening, as_json=json):
        raise typer.Exit(1)
