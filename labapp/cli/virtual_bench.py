"""The command that serves the virtual bench's instruments behind their true wires."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import BenchOption, ForceOption, ImageOption, SceneOption

virtual_bench = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
app.add_typer(virtual_bench, name="virtual-bench")


@virtual_bench.callback()
def virtual_bench_() -> None:
    """Simulated instruments behind true wires, for the real drivers."""


@dataclass(frozen=True)
class ServeCommandOptions:
    """Which instruments are served, where, and until when."""

    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Bench file to write (.toml).")
    ] = None
    filter: Annotated[
        str, typer.Option(help="varispec, thorlabs, starlight, zwo; none leaves it out.")
    ] = "varispec"
    camera: Annotated[str, typer.Option(help="gige; none leaves it out.")] = "gige"
    slm: Annotated[str, typer.Option(help="screen; none leaves it out.")] = "screen"
    spectroradiometer: Annotated[str, typer.Option(help="cs2000; none leaves it out.")] = "cs2000"
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
        bool, typer.Option("--until-eof", help="End with standard input, for scripts.")
    ] = False
    force: ForceOption = False


@virtual_bench.command(cls=command_with_options(ServeCommandOptions()))
def serve(
    context: typer.Context,
    bench: BenchOption = None,
    scene: SceneOption = None,
    image: ImageOption = None,
) -> None:
    """Serve a virtual bench at real ports, for the real drivers in other programs.

    The filter listens at a serial port or on a USB bus, the camera sends GigE Vision packets on
    this computer's loopback, what stands on a screen is on the SLM, and a CS-2000 measures at a
    port. All are before one virtual world: tune the filter, and the camera sees other light.

    The bench file that is printed, and written by --out, names their drivers and ports: use it
    in another terminal as that of a real bench, by **labapp gui --bench bench.toml** or
    **labapp run plan.toml --bench bench.toml --out run.h5**.

    Meanwhile it obeys lines on its standard input: **target star** puts another target before
    the camera, **fault filter silence 5** has the filter say nothing for 5 seconds, **mend
    filter**, **unplug camera**, **plug camera**, **state**, **help**, **quit**. Ctrl-C ends it,
    too, and nothing is left behind.

    It needs Linux; the camera needs Aravis (sudo apt-get install python3-gi
    gir1.2-aravis-0.8), the SLM without --display Xvfb (sudo apt-get install xvfb).
    """
    from labapp.bench.opening import BenchFiles
    from labapp.bench.virtual_bench.serving import ServeOptions, serve

    files = BenchFiles.with_defaults(bench, scene, image)
    serve(ServeOptions(files, **vars(get_option_group(context, ServeCommandOptions))))
