"""`labapp bracket`, which chooses the exposures of a bracket."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import RunOptions, light_in_nanometres, readable_path
from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_list


@app.command(cls=command_with_options(RunOptions()))
def bracket(
    context: typer.Context,
    snr_db: Annotated[
        float,
        typer.Option(metavar="DB", help="Signal-to-noise ratio of each merged pixel, 20 log10."),
    ],
    decades: Annotated[
        float | None,
        typer.Option(
            help="Depth of the range below the brightest pixels, in factors of ten.",
            show_default="down to the darkest pixels",
        ),
    ] = None,
    electrons: Annotated[
        str | None,
        typer.Option(
            metavar="LOW,HIGH",
            help="Range in electrons per second and pixel.",
            show_default="metered",
        ),
    ] = None,
    target: Annotated[str, typer.Option(help="Target to meter.")] = "star",
    pattern: Annotated[
        Path | None,
        typer.Option(
            callback=readable_path,
            help="Pattern on the panel while metering, an 8-bit picture. Default: neutral.",
        ),
    ] = None,
    wavelength_nm: Annotated[
        float,
        typer.Option(callback=light_in_nanometres, help="Wavelength of the filter, in nanometres."),
    ] = 550.0,
    least: Annotated[str, typer.Option(help="What to minimise: time or frames.")] = "time",
    most_frames: Annotated[int, typer.Option(help="Frames at most.")] = 16,
    darks: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Dark frames at each exposure; their noise and time count.",
            show_default="none: the black level is known",
        ),
    ] = None,
    any_exposure: Annotated[
        bool,
        typer.Option("--any-exposure", help="Exposures may end within a period of the flicker."),
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Diagram of the ratio over the range (.png)."),
    ] = None,
) -> None:
    """Choose the quickest exposure bracket that reaches a signal-to-noise ratio (--snr-db).

    A target is metered on the bench by a few frames, unless --electrons gives the range. The
    command prints the exposures, the ratio over the range, and ladders of exposures x2, x4 and x8
    that reach the same. Nothing is recorded. A plan asks for the same by
    `bracket = { snr_db = 30, decades = 3 }` in the place of `exposures_ms`. For instance

    **labapp bracket --snr-db 30 --electrons 1e3,1e6**
    """
    from labapp.files.bracket_table import BracketTable
    from labapp.files.reading import validate
    from labapp.runs.bracket_command import BracketCommand, choose_for_bench

    options = get_option_group(context, RunOptions)
    table = {
        "snr_db": snr_db,
        "decades": decades,
        "electrons_per_s": _read_range(electrons),
        "least": least,
        "most_frames": most_frames,
    }
    wanted = validate(table, BracketTable, "bracket")
    request = BracketCommand(wanted, target, pattern, wavelength_nm, darks, any_exposure, plot)
    choose_for_bench(request, options.bench_files(), options.run_mode)


def _read_range(text: str | None) -> list[float] | None:
    """Parse two rates in electrons per second; raise UserError if there aren't two."""
    if text is None:
        return None
    try:
        return parse_list(text, 2)
    except ValueError as error:
        raise UserError(f"--electrons {text}: give two rates, as 1e3,1e6: {error}.") from error
