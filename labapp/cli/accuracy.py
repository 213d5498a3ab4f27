"""Commands that measure what accuracy costs in time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.lens_options import CameraOptions, LensOptions, build_lens_case
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import (
    BenchOption,
    FieldOption,
    JsonOption,
    PeersOption,
    PictureOptions,
    RowsOutputOptions,
    readable_path,
)
from labapp.common.threads import use_one_thread

accuracy = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
app.add_typer(accuracy, name="accuracy")


@accuracy.callback()
def accuracy_() -> None:
    """Show what accuracy costs in time, measured on your machine."""
    use_one_thread()


_PEER_COMPARISON_LENS = LensOptions(0.1, 5.6, float("inf"), 2.0, 520.0)
"""What wave-optics libraries are compared on: 38 waves of defocus."""

_CHAIN = LensOptions(0.05, 16.0, 2.0, 1.5, size=64)


@accuracy.command("list")
def accuracy_list_(json: JsonOption = False) -> None:
    """List what can be measured, each a command of this one."""
    from labapp.common.list_output import ListEntry, print_list

    listed = [
        ListEntry(str(one.name), (one.callback.__doc__ or "").strip().splitlines()[0])
        for one in accuracy.registered_commands
        if one.callback and one.name != "list"
    ]
    print_list(listed, as_json=json, example="labapp accuracy psf --plot front.png")


@accuracy.command(
    "psf", cls=command_with_options(_PEER_COMPARISON_LENS, RowsOutputOptions(), options_first=True)
)
def accuracy_psf_(
    context: typer.Context,
    peers: PeersOption = False,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="What --json printed, kept, or 'bundled': name points that became 20 % slower "
            "(relative to a calibration kernel of each run) or 2x less accurate; exit code 1.",
        ),
    ] = None,
) -> None:
    """Measure error and time of every method for the PSF of a lens.

    The default case is the one that wave-optics libraries are compared on: 38 waves of
    defocus. Failures are rows too, and no other row beats one on the front in both time
    and error.
    """
    rows = get_option_group(context, RowsOutputOptions)
    rows.require_writable()
    described = get_option_group(context, LensOptions).build_case()
    from labapp.accuracy.command import accuracy_psf

    accuracy_psf(described, peers=peers, as_json=rows.json, plot=rows.plot, compare=compare)


@accuracy.command("propagate", cls=command_with_options(RowsOutputOptions()))
def accuracy_propagate_(
    context: typer.Context,
    light: Annotated[
        str,
        typer.Option(help="smooth (Gaussians that the samples resolve) or cells (random phases)."),
    ] = "smooth",
    distance: Annotated[
        float, typer.Option(help="From plane to plane, in metres; negative goes back.")
    ] = 0.05,
    wavelength_nm: Annotated[float, typer.Option(help="Wavelength in nanometres.")] = 550.0,
    pitch_um: Annotated[float, typer.Option(help="Of the field's samples, in micrometres.")] = 8.0,
    size: Annotated[int, typer.Option(help="Side of the square field, in samples.")] = 256,
    target_pitch_um: Annotated[
        float | None, typer.Option(show_default="the field's", help="On the target.")
    ] = None,
    target_size: Annotated[
        int | None, typer.Option(show_default="the field's", help="On the target.")
    ] = None,
    centre: Annotated[
        str, typer.Option(metavar="Y,X", help="The target's centre, in micrometres.")
    ] = "0,0",
    paraxial: Annotated[
        bool, typer.Option("--paraxial", help="Fresnel's model, not a scalar wave.")
    ] = False,
    peers: PeersOption = False,
) -> None:
    """Measure error and time of every method for a field's way through free space.

    Errors are those of the complex field against the exact integral, on samples drawn by
    their light. Failures are rows too, and no other row beats one on the front in both time
    and error.
    """
    from labapp.accuracy.option_validation import require_pitch, require_propagation
    from labapp.light.lens_options import read_window

    target_size = size if target_size is None else target_size
    target_pitch_um = pitch_um if target_pitch_um is None else target_pitch_um
    require_propagation(light, distance, wavelength_nm * 1e-9)
    require_pitch("pitch-um", pitch_um)
    require_pitch("target-pitch-um", target_pitch_um)
    rows = get_option_group(context, RowsOutputOptions)
    rows.require_writable()
    target = read_window(target_size, target_pitch_um * 1e-6, centre)
    source = read_window(size, pitch_um * 1e-6, "0,0")
    from labapp.accuracy.propagate import accuracy_propagate, field_case_from_options

    case = field_case_from_options(
        light, source, target, distance, wavelength_nm * 1e-9, paraxial=paraxial
    )
    accuracy_propagate(case, peers=peers, as_json=rows.json, plot=rows.plot)


@accuracy.command(
    "chain",
    cls=command_with_options(CameraOptions(), _CHAIN, RowsOutputOptions(), options_first=True),
)
def accuracy_chain_(
    context: typer.Context,
    separation_mm: Annotated[
        float | None, typer.Option(show_default="the camera's, or 50", help="From panel to lens.")
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
        bool, typer.Option("--sphere", help="The object's wave is a sphere, not a parabola.")
    ] = False,
    memory_mb: Annotated[int, typer.Option(help="Megabytes that a method may use.")] = 1000,
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
    from labapp.accuracy.option_validation import require_pattern
    from labapp.light.lens_options import read_field, read_panel

    off_axis = read_field(field)
    require_pattern(pattern)
    if panel is not None:
        read_panel(panel)
    rows = get_option_group(context, RowsOutputOptions)
    rows.require_writable()
    described = build_lens_case(context)
    from labapp.accuracy.chain import accuracy_chain, chain_case_from_options

    asked = chain_case_from_options(
        described,
        panel=panel,
        separation_mm=separation_mm,
        pattern=pattern,
        field=off_axis,
        sphere=sphere,
    )
    accuracy_chain(asked, memory=memory_mb * 1_000_000, as_json=rows.json, plot=rows.plot)


@accuracy.command("retrieval", cls=command_with_options(RowsOutputOptions()))
def accuracy_retrieval_(
    context: typer.Context,
    target: Annotated[
        str, typer.Argument(metavar="TARGET", help="Shape of the PSF, as for labapp retrieve.")
    ] = "spiral",
    keys: Annotated[
        list[str] | None,
        typer.Argument(metavar="[KEY=VALUE]...", help="Its keys, as for labapp retrieve."),
    ] = None,
    wavelength_nm: Annotated[float, typer.Option(help="For which the pattern is made.")] = 550.0,
    frames: Annotated[int, typer.Option(min=1, help="Frames of a video whose mean counts.")] = 1,
    budget: Annotated[
        float, typer.Option(metavar="S", help="Processor seconds that one setting may take.")
    ] = 10.0,
    bench: BenchOption = None,
) -> None:
    """Measure quality and time of every method that finds patterns, for a target.

    The thesis' own program is among them. There is no right answer: efficiency, speckle and
    the error of the shape are measured, and no other row beats one on the front in both time
    and error. What doesn't serve the target is a row too.
    """
    from labapp.patterns.designing.kinds import read_psf

    spec = read_psf(target, keys or [], wavelength_nm, {})
    rows = get_option_group(context, RowsOutputOptions)
    rows.require_writable()
    from labapp.accuracy.retrieval import accuracy_retrieval, goal_from_options

    goal, name = goal_from_options(spec, bench)
    accuracy_retrieval(goal, name, frames=frames, budget=budget, as_json=rows.json, plot=rows.plot)


@accuracy.command("deconvolve", cls=command_with_options(RowsOutputOptions()))
def accuracy_deconvolve_(
    context: typer.Context,
    picture: Annotated[
        Path | None,
        typer.Argument(
            metavar="[PICTURE]",
            callback=readable_path,
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
            callback=readable_path,
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
) -> None:
    """Measure quality and time of every method that undoes a blur, on a picture.

    The picture is blurred and made noisy; each method then finds noise and weights by itself.
    No other row beats one on the front in both time and error: it is by this front that
    **labapp reconstruct --budget** chooses. Failures are rows too.
    """
    from labapp.accuracy.blur_names import require_blur

    require_blur(blur, border)
    rows = get_option_group(context, RowsOutputOptions)
    rows.require_writable()
    from labapp.accuracy.blurs import photograph_from_options
    from labapp.accuracy.deconvolve import accuracy_deconvolve
    from labapp.pictures.networks import bundled_denoiser

    case = photograph_from_options(picture, blur, psf, noise, border, size, seed)
    accuracy_deconvolve(case, bundled_denoiser(), peers=peers, as_json=rows.json, plot=rows.plot)


@accuracy.command("simulate", cls=command_with_options(PictureOptions()))
def accuracy_simulate_(
    context: typer.Context,
    bench: Annotated[
        Path | None,
        typer.Option(
            callback=readable_path,
            help="Bench file (TOML).",
            show_default="the bundled one, with few pixels",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Measure what a tolerance costs a simulated picture, and whether it is kept.

    One picture is taken by the plan for each tolerance, and with every effect at its finest.
    Errors are those of the mean picture, of the map of variances, and of that of standard
    deviations. Everything on takes minutes on a bench of full size: hence the few pixels.
    """
    from labapp.accuracy.simulate import accuracy_simulate

    asked = get_option_group(context, PictureOptions).picture_request(bench)
    accuracy_simulate(asked, as_json=json)
