"""The command that undoes a photograph's blur."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import ForceOption, JsonOption, readable_path
from labapp.common.threads import use_one_thread
from optics.deconvolution.method_names import AUTO, METHOD_CHOICES


@app.command()
def reconstruct(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RUN.h5|IMAGE", callback=readable_path, help="A record, PNG, TIFF, JPEG or NPY."
        ),
    ],
    psf: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=readable_path,
            help="Picture or .npy of the PSF, or a record with a star.",
            show_default="the star of the record",
        ),
    ] = None,
    blind: Annotated[
        int | None,
        typer.Option(
            min=3, metavar="SIZE", help="Look for an unknown PSF of so many pixels at most."
        ),
    ] = None,
    method: Annotated[str, typer.Option(help=f"{', '.join(METHOD_CHOICES)}.")] = AUTO,
    budget: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="Processor seconds to stay within.", show_default="the usual"
        ),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(help="Standard deviation of a pixel's light.", show_default="estimated"),
    ] = None,
    weight: Annotated[
        float | None,
        typer.Option(help="Of the prior, in the method's unit.", show_default="by itself"),
    ] = None,
    border: Annotated[
        str, typer.Option(help="What lies beyond the frame: unknown, dark or periodic.")
    ] = "unknown",
    clip: Annotated[
        float | None,
        typer.Option(
            metavar="LEVEL", help="From which a pixel is full.", show_default="what the file shows"
        ),
    ] = None,
    dark: Annotated[
        float | None, typer.Option(metavar="LEVEL", help="To be subtracted.", show_default="0")
    ] = None,
    linear: Annotated[
        bool | None,
        typer.Option(
            "--linear/--srgb",
            help="Levels are proportional to light, or sRGB's.",
            show_default="sRGB in 8-bit pictures",
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(help="Of a record.", show_default="the plan's, or the last photograph"),
    ] = None,
    pattern: Annotated[
        str | None, typer.Option(help="Of a record.", show_default="the plan's, or the last")
    ] = None,
    wavelength_nm: Annotated[float | None, typer.Option(help="Of a record with several.")] = None,
    frame: Annotated[
        int | None, typer.Option(help="Of a record or TIFF.", show_default="all exposures, merged")
    ] = None,
    star: Annotated[
        str | None, typer.Option(help="Target with the PSF.", show_default="the plan's, or star")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help=".tiff or .npy (light, float), .png.",
            show_default="*_restored.tiff beside the input",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png",
            help="Before, after, PSF, residual.",
            show_default="*_before_after.png",
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", callback=readable_path, help="The picture as it should be, for PSNR."
        ),
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Undo a known blur, and show before and after.

    Colour is restored band by band. The noise is estimated and the weight chosen, if you don't
    say them. The border of the frame, clipped and dead (NaN) pixels aren't guessed: the
    restoration is of what was measured. A residual of about 1 is good: what is left of the
    photograph is its noise; above 1.2 model, PSF or noise doesn't fit. Of a record it is judged by
    the neutral photograph of the same run, unless you give a truth. **--blind SIZE** finds a
    blur that nobody measured from sharp edges in the picture, writes it beside the answer, and
    says how far to trust it; it takes a minute or so. A PSF's sum is made 1,
    but for the star of the same run, which is measured against the neutral one.
    """
    from labapp.files.output_paths import restoration_output_paths

    places = restoration_output_paths(
        source, out, picture, (psf, truth), blind=blind is not None, force=force
    )
    use_one_thread()
    from labapp.pictures.reconstructing.command import OutputFiles
    from labapp.pictures.reconstructing.command import reconstruct_photograph as restore
    from labapp.pictures.reconstructing.method_choice import MethodChoice
    from labapp.pictures.reconstructing.recorded_photograph import RecordSelection
    from labapp.pictures.reconstructing.restoration_request import RestorationRequest

    wavelength = None if wavelength_nm is None else wavelength_nm * 1e-9
    chosen = RecordSelection(target, pattern, wavelength, frame, star)
    told: dict[str, Any] = {"noise": noise, "border": border, "clip": clip, "dark": dark}
    told |= {"blind": blind, "truth": truth}
    asked = RestorationRequest(source, psf, chosen, linear, **told)
    restore(asked, MethodChoice(method, budget, weight), OutputFiles(*places), as_json=json)
