"""`labapp virtual-bench serve`, which serves simulated instruments to real drivers."""

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
