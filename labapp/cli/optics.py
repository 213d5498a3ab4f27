"""Commands for the optics engine: a PSF, and what accuracy costs."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from labapp.cli.app import app
from labapp.cli.lens import FieldOption, takes_case
from labapp.cli.options import (
    BenchOption,
    ForceOption,
    JsonOption,
    PeersOption,
    PlotOption,
    readable,
)


@app.command()
@takes_case(
    of_file=True,
    focal_length=0.125,
    f_number=5.0,
    focus=2.0,
    distance=2.0,
    wavelength_nm=550.0,
    pitch_um=3.45,
    size=256,
)
def psf(
    case: Callable[[], Any],
    out: Annotated[
        Path, typer.Option(metavar="FILE", help=".npy, .tiff (float) or .png to write.")
    ],
    tol: Annotated[
        float, typer.Option(help="Relative L2 error of sampling and arithmetic to keep.")
    ] = 1e-3,
    points: Annotated[
        bool, typer.Option("--points", help="Light at pixel centres, not on whole pixels.")
    ] = False,
    method: Annotated[
        str | None,
        typer.Option(
            help="Of a lens: axial, scattered or sampled. Of a camera: a transform, or where the "
            "panel stands apart, collapsed or chain. None: the cheapest that keeps tol."
        ),
    ] = None,
    memory_mb: Annotated[int, typer.Option(help="Megabytes that may be used.")] = 4000,
    pattern: Annotated[
        Path | None,
        typer.Option(
            callback=readable,
            help="8-bit picture on the SLM before the lens; none: a neutral one.",
        ),
    ] = None,
    field: FieldOption = "0,0",
    sphere: Annotated[
        bool,
        typer.Option("--sphere", help="The object's wave is a sphere, not a parabola."),
    ] = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Compute a PSF to a tolerance, and say what it cost and how far it can be trusted.

    Without a camera or a pattern: a lens with its stop. With a camera's file: its panel and,
    a separation behind it, its lens; the options of the lens count more than the file. With a
    pattern alone: the lens behind the panel of the virtual bench. Values are shares of the
    light, one a pixel; a picture of five decades is written beside the data.
    """
    from labapp.files.places import places_of_psf
    from labapp.light.asked import read_field

    off_axis, places = read_field(field), places_of_psf(out, force=force)
    one_thread()
    described = case()
    from labapp.light.predicting import Asked, predict

    memory = memory_mb * 1_000_000
    asked = Asked(described, tol, points, method, memory, pattern, off_axis, sphere)
    predict(asked, *places, as_json=json)


accuracy = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
app.add_typer(accuracy, name="accuracy")


@accuracy.callback()
def accuracy_() -> None:
    """Show what accuracy costs in time, measured on your machine."""
    one_thread()


def _require_writable(*paths: Path | None, force: bool) -> None:
    """UserError if a plot can't be written where it is asked for."""
    from labapp.files.writing import require_all_writable

    require_all_writable(paths, force=force)


def one_thread() -> None:
    """The libraries that multiply read this once, when they are loaded: it is early enough."""
    for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR"):
        os.environ[f"{library}_NUM_THREADS"] = "1"


@accuracy.command("psf")
@takes_case(
    focal_length=0.1,
    f_number=5.6,
    focus=float("inf"),
    distance=2.0,
    wavelength_nm=520.0,
    pitch_um=3.45,
    size=256,
)
def accuracy_psf_(
    case: Callable[[], Any],
    peers: PeersOption = False,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="What --json printed, kept, or 'bundled': name points that became 20 % slower "
            "(relative to a calibration kernel of each run) or 2x less accurate; exit code 1.",
        ),
    ] = None,
    json: JsonOption = False,
    plot: PlotOption = None,
    force: ForceOption = False,
) -> None:
    """Measure error and time of every method for the PSF of a lens.

    The default case is the one that wave-optics libraries are compared on: 38 waves of
    defocus. Failures are rows too, and no other row beats one on the front in both time
    and error.
    """
    _require_writable(plot, force=force)
    described = case()
    from labapp.accuracy.command import accuracy_psf

    accuracy_psf(described, peers=peers, as_json=json, plot=plot, compare=compare)


@accuracy.command("propagate")
def accuracy_propagate_(
    light: Annotated[
        str,
        typer.Option(help="smooth (Gaussians that the samples resolve) or cells (random phases)."),
    ] = "smooth",
    distance: Annotated[
        float, typer.Option(help="From plane to plane, in metres; negative goes back.")
    ] = 0.05,
    wavelength_nm: Annotated[
        float, typer.Option("--wavelength-nm", help="Wavelength in nanometres.")
    ] = 550.0,
    pitch_um: Annotated[
        float, typer.Option("--pitch-um", help="Of the field's samples, in micrometres.")
    ] = 8.0,
    size: Annotated[int, typer.Option(help="Side of the square field, in samples.")] = 256,
    target_pitch_um: Annotated[
        float | None,
        typer.Option("--target-pitch-um", show_default="the field's", help="On the target."),
    ] = None,
    target_size: Annotated[
        int | None,
        typer.Option("--target-size", show_default="the field's", help="On the target."),
    ] = None,
    centre: Annotated[
        str, typer.Option(metavar="Y,X", help="The target's centre, in micrometres.")
    ] = "0,0",
    paraxial: Annotated[
        bool, typer.Option("--paraxial", help="Fresnel's model, not a scalar wave.")
    ] = False,
    peers: PeersOption = False,
    json: JsonOption = False,
    plot: PlotOption = None,
    force: ForceOption = False,
) -> None:
    """Measure error and time of every method for a field's way through free space.

    Errors are those of the complex field against the exact integral, on samples drawn by
    their light. Failures are rows too, and no other row beats one on the front in both time
    and error.
    """
    from labapp.accuracy.asked import require_pitch, require_way
    from labapp.light.asked import read_window

    target_size = size if target_size is None else target_size
    target_pitch_um = pitch_um if target_pitch_um is None else target_pitch_um
    require_way(light, distance, wavelength_nm * 1e-9)
    require_pitch("pitch-um", pitch_um)
    require_pitch("target-pitch-um", target_pitch_um)
    _require_writable(plot, force=force)
    target = read_window(target_size, target_pitch_um * 1e-6, centre)
    source = read_window(size, pitch_um * 1e-6, "0,0")
    from labapp.accuracy.propagate import accuracy_propagate, asked_field

    case = asked_field(light, source, target, distance, wavelength_nm * 1e-9, paraxial=paraxial)
    accuracy_propagate(case, peers=peers, as_json=json, plot=plot)


@accuracy.command("chain")
@takes_case(
    of_file=True,
    focal_length=0.05,
    f_number=16.0,
    focus=2.0,
    distance=1.5,
    wavelength_nm=550.0,
    pitch_um=3.45,
    size=64,
)
def accuracy_chain_(
    case: Callable[[], Any],
    separation_mm: Annotated[
        float | None,
        typer.Option(
            "--separation-mm", show_default="the camera's, or 50", help="From panel to lens."
        ),
    ] = None,
    panel: Annotated[
        str | None,
        typer.Option(
            metavar="ROWSxCOLUMNSxUM",
            show_default="the camera's, or 96x128x8",
            help="Pixels of the panel, and their pitch in micrometres.",
        ),
    ] = None,
    pattern: Annotated[
        str, typer.Option(help="Phases on the panel: random, cubic or neutral.")
    ] = "random",
    field: FieldOption = "0,0",
    sphere: Annotated[
        bool,
        typer.Option("--sphere", help="The object's wave is a sphere, not a parabola."),
    ] = False,
    memory_mb: Annotated[int, typer.Option(help="Megabytes that a method may use.")] = 1000,
    json: JsonOption = False,
    plot: PlotOption = None,
    force: ForceOption = False,
) -> None:
    """Measure error and time of every method for a camera whose panel stands before its lens.

    Light goes from the point to the panel's pixels, on to lens and stop, and on to the sensor
    (thesis Eq. 5.1 to 5.7). "collapsed" makes one Fourier integral of it where the stop cuts
    nothing that matters; "chain" goes through the lens' plane on a grid; "chain, quadrature"
    on nodes that follow the stop's edge. The smaller the separation, the finer the light turns
    at the lens, and the longer the exact integral takes that errors are measured against, on
    samples drawn by their light. Failures are rows too, and no other row beats one on the
    front in both time and error.
    """
    from labapp.accuracy.asked import require_pattern
    from labapp.light.asked import read_field, read_panel

    off_axis = read_field(field)
    require_pattern(pattern)
    if panel is not None:
        read_panel(panel)
    _require_writable(plot, force=force)
    described = case()
    from labapp.accuracy.chain import accuracy_chain, asked_chain

    asked = asked_chain(
        described,
        panel=panel,
        separation_mm=separation_mm,
        pattern=pattern,
        field=off_axis,
        sphere=sphere,
    )
    accuracy_chain(asked, memory=memory_mb * 1_000_000, as_json=json, plot=plot)


@accuracy.command("retrieval")
def accuracy_retrieval_(
    target: Annotated[
        str, typer.Argument(metavar="TARGET", help="Shape of the PSF, as for labapp retrieve.")
    ] = "spiral",
    keys: Annotated[
        list[str] | None,
        typer.Argument(metavar="[KEY=VALUE]...", help="Its keys, as for labapp retrieve."),
    ] = None,
    wavelength_nm: Annotated[
        float, typer.Option("--wavelength-nm", help="For which the pattern is made.")
    ] = 550.0,
    frames: Annotated[int, typer.Option(min=1, help="Frames of a video whose mean counts.")] = 1,
    budget: Annotated[
        float, typer.Option(metavar="S", help="Processor seconds that one setting may take.")
    ] = 10.0,
    bench: BenchOption = None,
    json: JsonOption = False,
    plot: PlotOption = None,
    force: ForceOption = False,
) -> None:
    """Measure quality and time of every method that finds patterns, for a target.

    The thesis' own program is among them. There is no right answer: efficiency, speckle and
    the error of the shape are measured, and no other row beats one on the front in both time
    and error. What doesn't serve the target is a row too.
    """
    from labapp.patterns.designing.kinds import read_psf

    spec = read_psf(target, keys or [], wavelength_nm, {})
    _require_writable(plot, force=force)
    from labapp.accuracy.retrieval import accuracy_retrieval, asked_goal

    goal, name = asked_goal(spec, bench)
    accuracy_retrieval(goal, name, frames=frames, budget=budget, as_json=json, plot=plot)


@accuracy.command("deconvolve")
def accuracy_deconvolve_(
    picture: Annotated[
        Path | None,
        typer.Argument(
            metavar="[PICTURE]",
            callback=readable,
            help="A sharp one.",
            show_default="the demo's",
        ),
    ] = None,
    blur: Annotated[
        str, typer.Option(metavar="NAME", help="A wrong one lists them; lengths in pixels.")
    ] = "disk of 7",
    psf: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=readable,
            help="Picture or .npy of a PSF, in the blur's place.",
        ),
    ] = None,
    noise: Annotated[
        float, typer.Option(min=0, help="Standard deviation of a pixel; white is 1.")
    ] = 0.01,
    border: Annotated[
        str, typer.Option(help="unknown: what a camera sees; or periodic: a period seen whole.")
    ] = "unknown",
    size: Annotated[
        int, typer.Option(min=32, help="Pixels of a side that are cut from the middle, at most.")
    ] = 512,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    peers: PeersOption = False,
    json: JsonOption = False,
    plot: PlotOption = None,
    force: ForceOption = False,
) -> None:
    """Measure quality and time of every method that undoes a blur, on a picture.

    The picture is blurred and made noisy; each method then finds noise and weights by itself.
    No other row beats one on the front in both time and error: it is by this front that
    **labapp reconstruct --budget** chooses. Failures are rows too.
    """
    from labapp.accuracy.blur_names import require_blur

    require_blur(blur, border)
    _require_writable(plot, force=force)
    from labapp.accuracy.blurs import asked_photograph
    from labapp.accuracy.deconvolve import accuracy_deconvolve
    from labapp.pictures.networks import packaged_denoiser

    case = asked_photograph(picture, blur, psf, noise, border, size, seed)
    accuracy_deconvolve(case, packaged_denoiser(), peers=peers, as_json=json, plot=plot)
