"""`labapp accuracy ...`, which measures what accuracy costs: all of it, PSFs, and retrieval."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.lens_options import CameraOptions, LensOptions, build_lens_case
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import (
    BenchOption,
    CameraOption,
    FieldOption,
    ForceOption,
    JsonOption,
    PeersOption,
    RowsOutputOptions,
    SphereOption,
    WavelengthOption,
    light_option,
    require_writable_rows,
)
from labapp.common.errors import UserError
from labapp.common.threads import use_one_thread

accuracy = typer.Typer(invoke_without_command=True, rich_markup_mode="markdown")
app.add_typer(accuracy, name="accuracy")


@accuracy.callback()
def accuracy_(
    context: typer.Context,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder for the page and its JSON.",
            show_default="accuracy_DATE_TIME",
        ),
    ] = None,
    camera: CameraOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Measure what accuracy costs in time on your machine: everything, or one operation by name.

    Without a name, every operation is measured in some minutes: PSFs, propagation, simulated
    pictures, phase retrieval, and restoration. The result is one page, **accuracy.html**, and
    **accuracy.json** with all its numbers. The page shows for each operation what was asked and
    reached, the time of the first answer and of each further call, memory, what is chosen
    automatically, and what the next decimal costs. Ctrl-C keeps what was measured. For instance

    **labapp accuracy --out accuracy**

    **labapp accuracy --camera labapp/data/bench.toml --out bench-accuracy**

    With a name, the error and the time of every method are measured for a case that you describe:
    **labapp accuracy propagate --distance 0.05 --size 192**
    """
    if context.invoked_subcommand is not None:
        page_options = {"--out": out, "--camera": camera, "--force": force, "--json": json}
        for name, value in page_options.items():
            if value:
                raise UserError(
                    f"{name}: before a name it belongs to the page of everything. Put it after the "
                    "name, or leave the name out."
                )
        use_one_thread()
        return
    from labapp.files.output_paths import accuracy_folder

    folder = accuracy_folder(out, force=force)
    use_one_thread()
    from labapp.accuracy.overview.measuring import accuracy_page

    accuracy_page(camera, folder, as_json=json)


_PEER_COMPARISON_LENS = LensOptions(0.1, 5.6, float("inf"), 2.0, 520.0)
"""Lens on which wave-optics libraries are compared, with 38 waves of defocus."""

_CHAIN = LensOptions(0.05, 16.0, 2.0, 1.5, size=64)


@accuracy.command("list")
def accuracy_list_(json: JsonOption = False) -> None:
    """List the commands of **labapp accuracy**, and what each of them measures."""
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
            help="Compare with a file of earlier --json output, or with 'bundled': print points "
            "that became 20 % slower (relative to a calibration kernel of each run) or 2x less "
            "accurate; exit code 1.",
        ),
    ] = None,
) -> None:
    """Measure the error and time of every method for a lens's PSF (--focal-length, --f-number).

    Further options describe its stop, its aberrations, the object and the window.

    Each row is a method at one setting, with its relative L2 error against the exact integral and
    its processor time in ms. Rows on the front are beaten by no other row in both time and error. A
    method that fails has a row, too. The default case is the one on which wave-optics libraries are
    compared: 38 waves of defocus. For instance

    **labapp accuracy psf --size 64 --f-number 16 --plot front.png**
    """
    rows = require_writable_rows(context)
    described = get_option_group(context, LensOptions).build_case()
    from labapp.accuracy.command import accuracy_psf

    accuracy_psf(described, peers=peers, as_json=rows.json, plot=rows.plot, compare=compare)


@accuracy.command("propagate", cls=command_with_options(RowsOutputOptions()))
def accuracy_propagate_(
    context: typer.Context,
    light: Annotated[
        str,
        typer.Option(
            help="Field: smooth (Gaussians that the samples resolve) or cells (random phases)."
        ),
    ] = "smooth",
    distance: Annotated[
        float, typer.Option(help="Distance between the planes, in metres; negative goes back.")
    ] = 0.05,
    wavelength_nm: WavelengthOption = 550.0,
    pitch_um: Annotated[
        float, typer.Option(help="Pitch of the field's samples, in micrometres.")
    ] = 8.0,
    size: Annotated[int, typer.Option(help="Side of the square field, in samples.")] = 256,
    target_pitch_um: Annotated[
        float | None,
        typer.Option(
            show_default="the field's", help="Pitch of the target's samples, in micrometres."
        ),
    ] = None,
    target_size: Annotated[
        int | None,
        typer.Option(show_default="the field's", help="Side of the square target, in samples."),
    ] = None,
    centre: Annotated[
        str, typer.Option(metavar="Y,X", help="Centre of the target, in micrometres.")
    ] = "0,0",
    paraxial: Annotated[
        bool, typer.Option("--paraxial", help="Use the Fresnel model instead of the scalar wave.")
    ] = False,
    peers: PeersOption = False,
) -> None:
    """Measure the error and time of every method for propagation through free space (--distance).

    The error is the relative L2 error of the complex field against the exact integral. It is
    estimated from some samples; brighter ones are drawn more often. Rows on the front are beaten by
    no other row in both time and error. A method that fails has a row, too. For instance

    **labapp accuracy propagate --distance 0.05 --size 192**
    """
    from labapp.accuracy.option_validation import require_pitch, require_propagation
    from labapp.prediction.lens_options import read_window

    target_size = size if target_size is None else target_size
    target_pitch_um = pitch_um if target_pitch_um is None else target_pitch_um
    require_propagation(light, distance, wavelength_nm * 1e-9)
    require_pitch("pitch-um", pitch_um)
    require_pitch("target-pitch-um", target_pitch_um)
    rows = require_writable_rows(context)
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
        float | None,
        typer.Option(
            show_default="the camera's, or 50",
            help="Distance from the panel to the lens, in millimetres.",
        ),
    ] = None,
    panel: Annotated[
        str | None,
        typer.Option(
            metavar="ROWSxCOLUMNSxUM",
            show_default="the camera's, or 96x128x8",
            help="Number of panel pixels, and their pitch in micrometres.",
        ),
    ] = None,
    pattern: Annotated[
        str, typer.Option(help="Phase on the panel: random, cubic or neutral.")
    ] = "random",
    field: FieldOption = "0,0",
    sphere: SphereOption = False,
    memory_mb: Annotated[
        int, typer.Option(help="Memory that a method may use, in megabytes.")
    ] = 1000,
) -> None:
    """Measure the error and time of every PSF method for a panel in front of the lens (--panel).

    Light goes from a point to the pixels of the panel, to lens and stop, and to the sensor (thesis
    Eq. 5.1 to 5.7). The method "collapsed" is a single Fourier integral, for a stop that cuts off
    hardly any light. "chain" computes the field in the plane of the lens on a grid, "chain,
    quadrature" on nodes that follow the edge of the stop. "chain, direct" integrates along the rows
    of the stop, to rounding. Errors are relative L2 errors against the exact integral. They are
    estimated from some samples; brighter ones are drawn more often. The integral takes longer the
    smaller the separation is. Rows on the front are beaten by no other row in both time and error.
    For instance

    **labapp accuracy chain --size 16 --panel 48x64x8**
    """
    from labapp.accuracy.option_validation import require_pattern
    from labapp.prediction.lens_options import read_field, read_panel

    off_axis = read_field(field)
    require_pattern(pattern)
    if panel is not None:
        read_panel(panel)
    rows = require_writable_rows(context)
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
        typer.Argument(metavar="[KEY=VALUE]...", help="Keys of the target, as there."),
    ] = None,
    wavelength_nm: Annotated[
        float, light_option("Wavelength of the pattern, in nanometres.")
    ] = 550.0,
    frames: Annotated[
        int, typer.Option(min=1, help="Frames of a video; the mean of their PSFs counts.")
    ] = 1,
    budget: Annotated[
        float, typer.Option(metavar="S", help="Processor seconds that one setting may take.")
    ] = 10.0,
    bench: BenchOption = None,
) -> None:
    """Measure the quality and time of every phase retrieval method for the PSF shape TARGET.

    Retrieval has no exact answer. The table gives efficiency, speckle contrast, NRMSE of the PSF
    against the target, and processor time in seconds. Rows on the front are beaten by no other row
    in both time and NRMSE. The program of the thesis is one of the methods. A method that can't
    give the target has a row, too. For instance

    **labapp accuracy retrieval ring --budget 1**
    """
    from labapp.patterns.designing.kinds import read_psf

    spec = read_psf(target, keys or [], wavelength_nm, {})
    rows = require_writable_rows(context)
    from labapp.accuracy.retrieval import accuracy_retrieval, goal_from_options

    goal, name = goal_from_options(spec, bench)
    accuracy_retrieval(goal, name, frames=frames, budget=budget, as_json=rows.json, plot=rows.plot)
