"""Commands for a bench's devices: what is there, and whether each works."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import BenchOption, ForceOption, JsonOption, SceneOption

devices = typer.Typer(invoke_without_command=True, rich_markup_mode="markdown")
app.add_typer(devices, name="devices")


@devices.callback()
def devices_(
    context: typer.Context,
    bench: BenchOption = None,
    scene: SceneOption = None,
    json: JsonOption = False,
) -> None:
    """List the bench's devices, the installed drivers, and what is plugged in.

    **list** does the same; **test** tries a device out and reports; **screens** says which
    display is which.
    """
    if context.invoked_subcommand is None:
        devices_list_(bench, scene, json)


@devices.command("list")
def devices_list_(
    bench: BenchOption = None, scene: SceneOption = None, json: JsonOption = False
) -> None:
    """List the bench's devices, the installed drivers, and what is plugged in."""
    from labapp.bench.device_listing import list_devices

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
    from drivers.screen.identify import format_listing, identify_screens

    print(format_listing(identify_screens(display, seconds)))
