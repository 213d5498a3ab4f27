"""Listing and testing the devices of a bench: `labapp devices ...`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import BenchOption, ForceOption, JsonOption, SceneOption
from labapp.common.plain_text import printable

devices = typer.Typer(invoke_without_command=True, rich_markup_mode="markdown")
app.add_typer(devices, name="devices")


@devices.callback()
def devices_(
    context: typer.Context,
    bench: BenchOption = None,
    scene: SceneOption = None,
    json: JsonOption = False,
) -> None:
    """List a bench's devices (--bench) with their ranges, the installed drivers, and the ports.

    **list** does the same, **test** tests a device and writes a report, and **screens** shows which
    display is which. For instance

    **labapp devices --bench bench.toml**
    """
    if context.invoked_subcommand is None:
        devices_list_(bench, scene, json)


@devices.command("list")
def devices_list_(
    bench: BenchOption = None, scene: SceneOption = None, json: JsonOption = False
) -> None:
    """List a bench's devices (--bench) with their ranges, the installed drivers, and the ports."""
    from labapp.bench.device_listing import list_devices

    list_devices(bench, scene, as_json=json)


@devices.command("test")
def devices_test_(
    name: Annotated[
        str,
        typer.Argument(help="Device: slm, filter, camera, targets or spectroradiometer."),
    ],
    bench: BenchOption = None,
    scene: SceneOption = None,
    report: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the report here, as JSON.")
    ] = None,
    json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Test one device of a bench (--bench) alone, and report what it does.

    The SLM shows patterns and a video, the filter is tuned through its range, the camera takes
    pictures at several exposure times, and the spectroradiometer measures twice. The report can be
    sent to support. The exit code is 1 if a check fails. For instance

    **labapp devices test filter --out filter.json**
    """
    from labapp.bench.selftest.command import run_selftest

    if not run_selftest(name, bench, scene, report, as_json=json, force=force):
        raise typer.Exit(1)


@devices.command("screens")
def devices_screens_(
    display: Annotated[
        str | None, typer.Option(help="X server, such as :0.", show_default="$DISPLAY")
    ] = None,
    seconds: Annotated[
        float, typer.Option(min=0, help="Seconds for which the names are shown.")
    ] = 5.0,
) -> None:
    """Show each screen's name on it (for --seconds), and list the names for a bench file's SLM."""
    from drivers.screen.identify import format_listing, identify_screens

    print(printable(format_listing(identify_screens(display, seconds))))
