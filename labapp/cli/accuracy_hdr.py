"""`labapp accuracy hdr`, which measures what the accuracy of a merged bracket costs."""

from __future__ import annotations

from typing import Annotated

import typer

from labapp.cli.accuracy import accuracy
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import RowsOutputOptions
from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_whole, split_list


@accuracy.command("hdr", cls=command_with_options(RowsOutputOptions()))
def accuracy_hdr_(
    context: typer.Context,
    frames: Annotated[
        str, typer.Option(metavar="N,N,…", help="Numbers of exposures, each from 1 to 16.")
    ] = "1,2,3,4,6,8",
    ratio: Annotated[
        float, typer.Option(min=1.1, max=64, help="Ratio of each exposure time to the one before.")
    ] = 4.0,
    shortest_ms: Annotated[
        float, typer.Option(min=1e-3, max=1e6, help="Shortest exposure time, in milliseconds.")
    ] = 1.0,
    decades: Annotated[
        float,
        typer.Option(
            min=0.5, max=8, help="Decades of light, below what nearly clips the shortest exposure."
        ),
    ] = 4.0,
    darks: Annotated[int, typer.Option(min=1, max=100, help="Dark frames of each exposure.")] = 16,
    bits: Annotated[int, typer.Option(min=8, max=16, help="Bits of a digital number.")] = 12,
    gain: Annotated[
        float, typer.Option(min=1e-3, max=1e3, help="Electrons per digital number.")
    ] = 2.6,
    read_noise: Annotated[
        float, typer.Option(min=0, max=1e4, help="Read noise in electrons.")
    ] = 2.4,
    pixels: Annotated[
        int, typer.Option(min=100, max=1_000_000, help="Pixels of each of 48 levels of light.")
    ] = 2000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
) -> None:
    """Measure the error and time of merges of brackets, by exposures and total time (--frames).

    Frames of even light at many levels are simulated with the noise of photons, reading and
    rounding, and merged by every method, and by OpenCV's methods of Debevec and Robertson. The
    table gives relative errors beside the ones that each method states, the efficiency against the
    least variance of any unbiased estimate, bias, and processor time in ms. Rows on the front are
    beaten by no other row in both time and error; **labapp merge --budget** chooses among such
    methods. A method that fails has a row, too. The diagram (--plot) shows errors by exposures with
    their total time, beside the least possible ones, and by processor time. For instance

    **labapp accuracy hdr --frames 2,4 --pixels 500**
    """
    counts = _read_counts(frames)
    rows = get_option_group(context, RowsOutputOptions)
    rows.require_writable()
    from labapp.accuracy.hdr import accuracy_hdr
    from labapp.accuracy.hdr_case import BracketCase

    cases = [
        BracketCase(
            count, ratio, shortest_ms * 1e-3, decades, darks, bits, gain, read_noise, pixels, seed
        )
        for count in counts
    ]
    accuracy_hdr(cases, as_json=rows.json, plot=rows.plot)


def _read_counts(text: str) -> list[int]:
    """Parse the numbers of exposures, rising; raise UserError unless all are 1 to 16."""
    try:
        counts = sorted({parse_whole(part) for part in split_list(text)})
    except ValueError:
        counts = []
    if not counts or not 1 <= counts[0] <= counts[-1] <= 16:
        raise UserError(
            f"--frames {text}: give whole numbers from 1 to 16 with commas between them, as in 2,4."
        )
    return counts
