"""Commands for the bench itself: what is there, whether it works, and its window."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.options import (
    BenchOption,
    FaultsOption,
    ForceOption,
    ImageOption,
    JsonOption,
    SceneOption,
    readable,
)

devices = typer.Typer(invoke_without_command=True, rich_markup_mode="markdown")
app.add_typer(devices, name="devices")

bench = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
app.add_typer(bench, name="bench")


@devices.callback()
def devices_(
    context: typer.Context,
    bench: BenchOption = None,
    scene: SceneOption = None,
    json: JsonOption = False,
) -> None:
    """List the bench's devices, the installed drivers, and what is plugged in.

    **test** tries a device out and reports; **screens** says which display is which.
    """
    if context.invoked_subcommand is not None:
        return
    from labapp.bench.listing import list_devices

    list_devices(bench, scene, as_json=json)


@devices.command("test")
def devices_test_(
    name: Annotated[str, typer.Argument(help="slm, filter, camera, targets or spectroradiometer.")],
    bench: BenchOption = None,
    scene: SceneOption = None,
    report: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Keep the report, as JSON.")
    ] = None,
    json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Try a device out, alone: does it do what it says? The report is for support, too.

    The SLM shows patterns and a video, the filter is tuned through its range, the camera takes
    pictures of several exposures, the spectroradiometer measures twice. Exit code 1 if a check
    fails.
    """
    from labapp.bench.selftest.command import run_selftest

    if not run_selftest(name, bench, scene, report, as_json=json, force=force):
        raise typer.Exit(1)


@devices.command("screens")
def devices_screens_(
    display: Annotated[
        str | None, typer.Option(help="X server, such as :0.", show_default="$DISPLAY")
    ] = None,
    seconds: Annotated[float, typer.Option(min=0, help="How long the names stand.")] = 5.0,
) -> None:
    """Write on every screen which it is, and list them: names for a bench file's SLM."""
    from drivers.screen.identify import identify, listed

    print(listed(identify(display, seconds)))


@bench.callback()
def bench_() -> None:
    """Look at bench files before they are used."""


@bench.command("check")
def bench_check_(
    bench: Annotated[
        Path, typer.Argument(metavar="BENCH.toml", callback=readable, help="Bench file.")
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
    from labapp.bench.checking import check_bench

    if not check_bench(bench, scene, opening=opening, as_json=json):
        raise typer.Exit(1)


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
