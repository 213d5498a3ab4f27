"""The command `labapp reconstruct`, which restores a blurred photograph."""

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
            metavar="RUN.h5|IMAGE",
            callback=readable_path,
            help="Record of a run, or a PNG, TIFF, JPEG or NPY picture.",
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
            min=3, metavar="SIZE", help="Estimate an unknown PSF of at most SIZE pixels a side."
        ),
    ] = None,
    method: Annotated[str, typer.Option(help=f"Method: {', '.join(METHOD_CHOICES)}.")] = AUTO,
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
        typer.Option(
            help="Regularisation weight in the method's unit; needs --method.",
            show_default="chosen from the picture",
        ),
    ] = None,
    refine_psf: Annotated[
        bool,
        typer.Option("--refine-psf", help="Scale the PSF to the size that the picture shows."),
    ] = False,
    border: Annotated[
        str, typer.Option(help="What lies beyond the frame: unknown, dark or periodic.")
    ] = "unknown",
    clip: Annotated[
        float | None,
        typer.Option(
            metavar="LEVEL",
            help="Level from which a pixel counts as clipped.",
            show_default="what the file shows",
        ),
    ] = None,
    dark: Annotated[
        float | None,
        typer.Option(metavar="LEVEL", help="Level of darkness to subtract.", show_default="0"),
    ] = None,
    linear: Annotated[
        bool | None,
        typer.Option(
            "--linear/--srgb",
            help="Take levels as proportional to light, or as sRGB.",
            show_default="sRGB in 8-bit pictures",
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(help="Target of a record.", show_default="the plan's, or the last photograph"),
    ] = None,
    pattern: Annotated[
        str | None,
        typer.Option(help="Pattern of a record.", show_default="the plan's, or the last"),
    ] = None,
    wavelength_nm: Annotated[
        float | None,
        typer.Option(help="Wavelength in nanometres, for a record with several."),
    ] = None,
    frame: Annotated[
        int | None,
        typer.Option(help="Frame of a record or TIFF.", show_default="all exposures, merged"),
    ] = None,
    star: Annotated[
        str | None,
        typer.Option(
            help="Target of a record that is the star.", show_default="the plan's, or star"
        ),
    ] = None,
    grey: Annotated[
        bool,
        typer.Option(
            "--grey",
            help="Restore one band of a record with colour filters, for light of one colour.",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Restored picture to write: .tiff or .npy (light, float) or .png.",
            show_default="*_restored.tiff beside the input",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png",
            help="Drawing to write: before, after, PSF and residual.",
            show_default="*_before_after.png",
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=readable_path,
            help="True picture, against which PSNR and SSIM are measured.",
        ),
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Restore a photograph that was blurred by a PSF (--psf), and show before and after.

    Colours of a picture are restored band by band; those of a record whose sensor has colour
    filters are restored together from the bare pixels, with the PSF of the star in each colour. Its
    .tiff and .npy hold the filters' bands, in which white is equal, and a .png holds sRGB.
    Without options the noise is estimated and the weight chosen.
    The scene beyond the frame, clipped pixels and dead ones (NaN) count as unknown. The verdict
    says whether photograph, PSF and noise fit together, and what doesn't: a PSF of a wrong
    scale (**--refine-psf** mends it), a noise that was told wrongly, clipped pixels that weren't
    marked. It can't see a common shift of the PSF, which only moves the picture. The
    restoration of a record is compared with the neutral photograph of the run, unless
    --truth is given. **--blind SIZE** estimates an unknown PSF from sharp edges in the picture,
    writes it beside the result, and says how far to trust it; this takes about a minute. A PSF is
    scaled to a sum of 1, except for the star of the same run, which is measured relative to the
    neutral star. For instance

    **labapp reconstruct first-light/run.h5 --budget 2 --out restored.png**
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
    chosen = RecordSelection(target, pattern, wavelength, frame, star, grey)
    told: dict[str, Any] = {"noise": noise, "border": border, "clip": clip, "dark": dark}
    told |= {"blind": blind, "truth": truth}
    asked = RestorationRequest(source, psf, chosen, linear, **told)
    restore(
        asked, MethodChoice(method, budget, weight, refine_psf), OutputFiles(*places), as_json=json
    )
