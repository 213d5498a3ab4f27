"""Benches and devices: `labapp devices ...`, `labapp bench ...`, `labapp virtual-bench ...`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import (
    BenchOption,
    ForceOption,
    ImageOption,
    JsonOption,
    SceneOption,
    readable_path,
)
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


virtual_bench = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
app.add_typer(virtual_bench, name="virtual-bench")


@virtual_bench.callback()
def virtual_bench_() -> None:
    """Serve simulated instruments at real ports, for the real drivers, from the command line."""


@dataclass(frozen=True)
class ServeCommandOptions:
    """Which instruments are served, where, and until when."""

    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Bench file to write (.toml).")
    ] = None
    filter: Annotated[
        str,
        typer.Option(help="Filter: varispec, thorlabs, starlight or zwo; none leaves it out."),
    ] = "varispec"
    camera: Annotated[str, typer.Option(help="Camera: gige; none leaves it out.")] = "gige"
    slm: Annotated[str, typer.Option(help="SLM: screen; none leaves it out.")] = "screen"
    spectroradiometer: Annotated[
        str, typer.Option(help="Spectroradiometer: cs2000; none leaves it out.")
    ] = "cs2000"
    display: Annotated[
        str,
        typer.Option(
            help="X display that has the SLM's screen, such as :0.",
            show_default="an Xvfb of its own",
        ),
    ] = ""
    screen: Annotated[
        str,
        typer.Option(
            help="The SLM's screen: an output (HDMI-1), or its monitor's model or serial number.",
            show_default="the one of its size",
        ),
    ] = ""
    folder: Annotated[
        Path | None, typer.Option(help="Folder for the ports, so that they keep their names.")
    ] = None
    until_eof: Annotated[
        bool,
        typer.Option("--until-eof", help="Stop at the end of standard input, for scripts."),
    ] = False
    force: ForceOption = False


@virtual_bench.command(cls=command_with_options(ServeCommandOptions()))
def serve(
    context: typer.Context,
    bench: BenchOption = None,
    scene: SceneOption = None,
    image: ImageOption = None,
) -> None:
    """Serve a virtual bench (--bench) at real ports, for the real drivers in other programs.

    The filter listens at a serial port or on a USB bus. The camera sends GigE Vision packets on
    this computer's loopback. The SLM shows what is on a screen. A CS-2000 spectroradiometer listens
    at a serial port. All instruments share one virtual world: after the filter is tuned, the camera
    sees other light. For instance

    **labapp virtual-bench serve --out bench.toml**

    The bench file is printed, and written by --out. It names drivers and ports. Use it in another
    terminal like that of a real bench, by **labapp gui --bench bench.toml** or **labapp run
    plan.toml --bench bench.toml --out run.h5**.

    The command accepts lines on standard input: **target star** puts a target in front of the
    camera, **fault filter silence 5** keeps the filter silent for 5 seconds, **mend filter** ends
    its faults, **unplug camera** and **plug camera** pull and insert a plug, **state** and **help**
    print what their names say, and **quit** or Ctrl-C ends the bench and removes its ports.

    It needs Linux. The camera needs Aravis (sudo apt-get install python3-gi gir1.2-aravis-0.8); the
    SLM needs Xvfb (sudo apt-get install xvfb) unless --display is given.
    """
    from labapp.bench.opening import BenchFiles
    from labapp.bench.virtual_bench.serving import ServeOptions, serve

    files = BenchFiles.with_defaults(bench, scene, image)
    serve(ServeOptions(files, **vars(get_option_group(context, ServeCommandOptions))))
