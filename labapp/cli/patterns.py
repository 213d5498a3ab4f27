"""Commands that make patterns: from formulas, and from the PSF that they shall give."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from labapp.cli.app import app
from labapp.cli.optics import one_thread
from labapp.cli.options import BenchOption, ForceOption, JsonOption

KeysArgument = Annotated[
    list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Its keys, as in a plan file.")
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FILE",
        help=".png for any SLM software, or .h5 with everything that it was made from.",
    ),
]
WavelengthOption = Annotated[
    float, typer.Option("--wavelength-nm", help="For which it is made, and its PSF predicted.")
]
FramesOption = Annotated[
    int, typer.Option("--frames", min=1, help="Of a video: numbered .png files, or one .h5.")
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="All chance comes from it.")]
SizeOption = Annotated[
    int | None,
    typer.Option("--size", min=16, max=2048, help="Sensor pixels across the predicted PSF."),
]


@app.command()
def pattern(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Kind of pattern, or 'list'.")],
    keys: KeysArgument = None,
    out: OutOption = None,
    wavelength_nm: WavelengthOption = 550.0,
    frames: FramesOption = 1,
    seed: SeedOption = 1,
    size: SizeOption = None,
    bench: BenchOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Make a pattern for the SLM, and a picture of the PSF that it will give.

    **labapp pattern list** tells the kinds with their keys: lenses, gratings, cubic and annular
    masks, sines, patches, Zernike polynomials, sums, pictures. For instance

    **labapp pattern lens focal_length_m=20 --out lens.png**

    writes lens.png, grey levels of the panel's size, and lens_psf.png. A pattern that is steeper
    than the pixels allow is refused, with the limit.
    """
    from labapp.patterns.designing.kinds import list_patterns, read_pattern

    if name == "list":
        list_patterns(as_json=json)
        return
    spec = read_pattern(name, keys or [], wavelength_nm)
    _make(spec, out, wavelength_nm, frames, seed, size, bench, force=force, json=json)


@app.command()
def retrieve(
    target: Annotated[str, typer.Argument(metavar="TARGET", help="Shape of the PSF, or 'list'.")],
    keys: KeysArgument = None,
    out: OutOption = None,
    wavelength_nm: WavelengthOption = 550.0,
    frames: FramesOption = 1,
    budget: Annotated[
        float | None,
        typer.Option("--budget", metavar="S", help="Processor seconds to spend; more is better."),
    ] = None,
    iterations: Annotated[
        int | None, typer.Option("--iterations", min=1, help="Instead of a budget.")
    ] = None,
    method: Annotated[
        str | None, typer.Option("--method", help="Of retrieval; none: what serves best.")
    ] = None,
    seed: SeedOption = 1,
    size: SizeOption = None,
    bench: BenchOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Find a pattern, or a video, whose PSF has the shape of a target.

    **labapp retrieve list** tells the shapes with their keys: ring, spiral, dots, heart,
    infinity, eye, letters, a logo from a picture, a row of dots. For instance

    **labapp retrieve letters text=EI --frames 8 --out letters.h5**

    The frames of a video know of each other: their mean has the shape, with hardly any speckle.
    There is no right answer: the quality reached is measured and printed.
    """
    from labapp.patterns.designing.kinds import list_targets, read_psf

    if target == "list":
        list_targets(as_json=json)
        return
    options = {"budget_s": budget, "iterations": iterations, "method": method}
    spec = read_psf(target, keys or [], wavelength_nm, options)
    _make(spec, out, wavelength_nm, frames, seed, size, bench, force=force, json=json)


def _make(
    spec: Any,
    path: Path | None,
    wavelength_nm: float,
    frames: int,
    seed: int,
    side: int | None,
    bench: Path | None,
    *,
    force: bool,
    json: bool,
) -> None:
    from labapp.common.errors import UserError
    from labapp.files.places import places_of_pattern
    from labapp.patterns.designing.asked import AskedDesign

    if path is None:
        raise UserError("there is no --out. Name a .png or .h5 file to write.")
    wavelength = getattr(spec, "wavelength_nm", wavelength_nm) * 1e-9
    asked = AskedDesign(spec, wavelength, frames, seed, bench, side)
    files, drawn = places_of_pattern(path, frames, force=force)
    one_thread()
    from labapp.patterns.designing.command import make

    make(asked, files, drawn, as_json=json)
