"""Exposure brackets: chosen by `labapp bracket`, and merged, of any camera, by `labapp merge`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.app import app
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import (
    ForceOption,
    JsonOption,
    ReadoutOption,
    RunOptions,
    file_option,
    find_encoding,
    light_option,
    readable_path,
)
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
        file_option("Pattern on the panel while metering, an 8-bit picture. Default: neutral."),
    ] = None,
    wavelength_nm: Annotated[
        float, light_option("Wavelength of the filter, in nanometres.")
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


def readable_paths(paths: list[Path]) -> list[Path]:
    """Return the paths; raise UserError if one can't be opened."""
    return [path for path in map(readable_path, paths) if path is not None]


@app.command()
def merge(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="IMAGE...|RUN.h5",
            callback=readable_paths,
            help="Frames of the bracket: TIFF, PNG or .npy, of 8 or 16 bits, grey or colour; a "
            "camera's RAW files; one TIFF of several pages; or the record of a run.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(metavar="FILE.h5", help="File to write; .tiff, .png and .html beside it."),
    ],
    exposures: Annotated[
        str | None,
        typer.Option(
            metavar="S,S,…",
            help="Exposure time of each frame in seconds, in the files' order, as in 0.001,1/250; "
            "or steps of EV between them, as in -2ev,0ev,+2ev.",
            show_default="the record's, or the files'",
        ),
    ] = None,
    dark: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="IMAGE",
            callback=lambda paths: readable_paths(paths or []),
            help="Dark frame; repeat it. As many for each exposure, in their order, or some for "
            "all of them.",
            show_default="the record's, or the black level",
        ),
    ] = None,
    sensor: Annotated[
        Path | None, file_option("Sensor file (TOML) that tells the noise.", metavar="FILE")
    ] = None,
    gain: Annotated[
        float | None,
        typer.Option(metavar="E", help="Electrons per digital number; overrides the sensor file."),
    ] = None,
    read_noise: Annotated[
        float | None, typer.Option(metavar="E", help="Read noise in electrons.")
    ] = None,
    black: Annotated[
        float | None,
        typer.Option(
            metavar="DN", help="Digital number of no light.", show_default="0, or RAW files'"
        ),
    ] = None,
    full_scale: Annotated[
        int | None,
        typer.Option(
            metavar="DN",
            help="Digital number from which a pixel is clipped.",
            show_default="the file's largest, or RAW files' white",
        ),
    ] = None,
    target: Annotated[
        str | None, typer.Option(help="Target of a record.", show_default="the only one")
    ] = None,
    pattern: Annotated[
        str | None, typer.Option(help="Pattern of a record.", show_default="the only one")
    ] = None,
    wavelength_nm: Annotated[
        float | None,
        light_option("Wavelength of a record in nanometres.", show_default="the only one"),
    ] = None,
    readout: ReadoutOption = None,
    encoding: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            callback=find_encoding,
            help="How numbers stand for light: linear, srgb, bt709, or gamma 2.2, or another.",
            show_default="what the files say, or measured in 8-bit pictures without further word",
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="Weights of exposures: full, Granados, Poisson or plain.", show_default="full"
        ),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Processor seconds that merging may take, in the place of --method: the best "
            "method is taken that fits.",
            show_default="no limit",
        ),
    ] = None,
    as_given: Annotated[
        bool,
        typer.Option(
            "--as-given", help="Trust the exposure times; don't measure them on the frames."
        ),
    ] = False,
    align: Annotated[
        bool,
        typer.Option("--align", help="Register frames that moved or turned, as hand-held ones do."),
    ] = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Merge an exposure bracket into light with its variance and the state of each pixel (--out).

    Exposures near their clip levels count without bias, those that contradict the others are left
    out pixel by pixel, and wrong exposure times are measured and named. The report tells how
    accurate the merge is, by simulating it. 8-bit pictures, if nothing is said of their numbers and
    noise, are merged by the response curve that they show themselves; three of them tell that an
    exposure time is wrong, and four which. Frames that moved are named. For instance

    **labapp merge a.tiff b.tiff c.tiff --exposures 0.001,0.008,0.064 --gain 2.6 --read-noise 2.4
    --black 64 --out merged.h5**

    RAW files of one camera tell all of that, or show their noise. Their mosaic is merged, and .tiff
    and .png beside it are in colour:

    **labapp merge a.dng b.dng c.dng --out merged.h5**
    """
    from labapp.pictures.merging.bracket_files import SensorNumbers
    from labapp.pictures.merging.bracket_record import RecordedFrames
    from labapp.pictures.merging.exposure_words import parse_exposures
    from labapp.pictures.merging.merge_command import MergeRequest, merge_bracket_files
    from optics.hdr import METHODS

    found = next((one for one in METHODS if one == (method or "full")), None)
    if found is None:
        raise UserError(f"--method {method}: choose one of {', '.join(METHODS)}.")
    if method is not None and budget is not None:
        raise UserError("--method, --budget: give one of them; a budget chooses the method.")
    times = None if exposures is None else parse_exposures(exposures)
    wavelength = None if wavelength_nm is None else wavelength_nm * 1e-9
    request = MergeRequest(
        files, times, dark or [], sensor,
        SensorNumbers(gain, read_noise, black, full_scale),
        RecordedFrames(target, pattern, wavelength, readout), encoding, found, budget,
        not as_given, align, out, force,
    )  # fmt: skip
    merge_bracket_files(request, as_json=json)
