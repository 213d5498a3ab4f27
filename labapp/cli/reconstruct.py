"""Restoring a blurred photograph, or a spectral cube: `labapp reconstruct`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from labapp.cli.app import app
from labapp.cli.shared_options import (
    EncodingOption,
    ForceOption,
    JsonOption,
    ReadoutOption,
    file_option,
    light_option,
    readable_path,
    require_options_of_kind,
)
from labapp.common.errors import UserError
from labapp.common.threads import use_one_thread
from optics.inverse.method_names import AUTO, METHOD_CHOICES


@app.command()
def reconstruct(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RUN.h5|MERGED.h5|RAW|IMAGE",
            callback=readable_path,
            help="Record of a run, a bracket that labapp merge wrote, a camera's RAW file (DNG and "
            "others), or a picture: PNG, TIFF, JPEG, OpenEXR, .npy … (labapp help pictures).",
        ),
    ],
    psf: Annotated[
        Path | None,
        file_option(
            "Picture or .npy of the PSF, or a record with a star. With --bands: a cube or "
            ".npy of a PSF for each band, or such a record.",
            metavar="FILE",
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
        typer.Option(
            help="Standard deviation of a pixel's light.",
            show_default="a bracket's variance map, or estimated",
        ),
    ] = None,
    weight: Annotated[
        float | None,
        typer.Option(
            help="Regularisation weight in the method's unit; needs --method or --bands.",
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
    encoding: EncodingOption = None,
    target: Annotated[
        str | None,
        typer.Option(help="Target of a record.", show_default="the plan's, or the last photograph"),
    ] = None,
    pattern: Annotated[
        str | None,
        typer.Option(help="Pattern of a record.", show_default="the plan's, or the last"),
    ] = None,
    wavelength_nm: Annotated[
        float | None, light_option("Wavelength in nanometres, for a record with several.")
    ] = None,
    frame: Annotated[
        int | None,
        typer.Option(
            help="Frame of a record, or page of a TIFF.", show_default="all exposures, merged"
        ),
    ] = None,
    readout: ReadoutOption = None,
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
            help="Restore one band of a record or RAW file with colour filters, for light of one "
            "colour. With --decoder, also of a colour picture.",
        ),
    ] = False,
    decoder: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.h5|edof",
            help="Decode a photograph behind a trained pattern, at all depths at once: design file "
            "of labapp train edof, or edof for the bundled one.",
            show_default="a PSF undone",
        ),
    ] = None,
    bands: Annotated[
        str | None,
        typer.Option(
            metavar="NM,NM,…",
            help="Restore a spectral cube from a record's coded snapshot: wavelengths of its bands "
            "in nanometres, as in 450,500,550, or all that the record has.",
            show_default="a photograph",
        ),
    ] = None,
    white: Annotated[
        str | None,
        typer.Option(
            metavar="TARGET",
            help="With --bands, target of the record that is white: a white sheet, or the star.",
            show_default="flat, or else the star",
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        file_option(
            "With --bands, PSFs and response by labapp calibrate --spectra.",
            metavar="spectra.json",
            show_default="the record's star and white",
        ),
    ] = None,
    refine: Annotated[
        bool,
        typer.Option(
            "--refine",
            help="With --bands, refine PSFs and response from the photograph; takes minutes.",
        ),
    ] = False,
    light: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="With --bands, light in which the cube's colours are shown and compared: a CIE "
            "illuminant, such as D65 or A, or a CSV file of wavelengths in nm and power.",
            show_default="D65",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Restored picture to write: .tiff, .exr, .hdr (Radiance) or .npy (light, float) "
            "or .png. With --bands: .h5, or .hdr for ENVI, with a .raw beside it.",
            show_default="*_restored.tiff, *_decoded.tiff or *_cube.h5 beside the input",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png",
            help="Drawing to write: before, after, PSF and residual; with --decoder, PSF and "
            "pattern; with --bands, each band.",
            show_default="*_before_after.png or *_bands.png",
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        file_option(
            "True picture, against which PSNR and SSIM are measured. With --bands: a cube, or "
            "a record of the neutral photographs.",
            metavar="FILE",
        ),
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Restore a photograph that was blurred by a PSF (--psf), and show before and after.

    With **--decoder**, decode a photograph behind a trained pattern; with **--bands**, restore a
    spectral cube.

    Colours of a picture are restored band by band. Those of a RAW file, or of a record whose sensor
    has colour filters, are restored together from the bare pixels; a record's with the PSF of the
    star in each colour. Their .tiff and .npy hold the filters' bands, in which white is equal, and
    a .png holds sRGB.
    Without options the noise is estimated and the weight chosen.
    The scene beyond the frame, clipped pixels and dead ones (NaN) count as unknown. The verdict
    says whether photograph, PSF and noise fit together, and what doesn't: a PSF of a wrong scale
    (**--refine-psf** mends it), a noise that was told wrongly, clipped pixels that weren't marked.
    It can't see a common shift of the PSF, which only moves the picture. A bracket has a variance
    map: pixels are weighted by it where that gains, and the row "variance map" says what it gained
    by an estimate, or why it isn't used. The restoration of a record is compared with the neutral
    photograph of the run, unless --truth is given. **--blind SIZE** estimates an unknown PSF from
    sharp edges in the picture, writes it beside the result, and says how far to trust it; this
    takes about a minute. A PSF is scaled to a sum of 1, except for the star of the same run, which
    is measured relative to the neutral star. For instance

    **labapp reconstruct first-light/run.h5 --budget 2 --out restored.png**

    **--decoder FILE.h5** takes no PSF: the photograph was taken through a pattern that extends the
    depth of field, and its decoder, which **labapp train edof** trained with it, makes it sharp at
    all depths at once. It is blind: it sees the photograph and isn't told any depth. The pattern in
    a record must be the decoder's; phases are compared, because a calibrated panel shows them by
    other grey levels. The decoder's filter is made for the record's camera; a picture file is taken
    to be of the camera of the training. Clipped and dead pixels are filled first, and counted. For
    instance

    **labapp reconstruct run.h5 --decoder edof --out sharp.png**

    **--bands 450,500,550** takes the record's photograph through the coded pattern for a snapshot
    of all bands at once. Where a filter is always in the beam, it is the sum of the photographs at
    each wavelength, because light adds. Every band is blurred by the PSF of the star at its
    wavelength, and seen by each filter of the sensor as its curve says; what the photograph can't
    tell apart follows from the spectra of typical things. The cube is in shares of white: of a
    white sheet that the record has as target "flat", or else of the star's light. It is written
    with its colours in --light and a drawing of all bands, and scored against the neutral
    photographs of the run if it has them. **labapp help multispectral** says how to record and
    judge one. For instance

    **labapp reconstruct run.h5 --bands 450,500,550,600,650,700 --out leaf.hdr**
    """
    photograph_only = {
        "--blind": blind, "--budget": budget, "--refine-psf": refine_psf or None, "--clip": clip,
        "--method": None if method == AUTO else method, "--dark": dark, "--encoding": encoding,
        "--wavelength-nm": wavelength_nm, "--frame": frame, "--grey": grey or None,
        "--readout": readout,
    }  # fmt: skip
    spectral_only = {
        "--white": white, "--light": light, "--calibration": calibration,
        "--refine": refine or None,
    }  # fmt: skip
    not_decoding = {
        "--psf": psf, "--blind": blind, "--method": None if method == AUTO else method,
        "--budget": budget, "--weight": weight, "--refine-psf": refine_psf or None,
        "--border": None if border == "unknown" else border, "--star": star,
    }  # fmt: skip
    if decoder is not None and bands is not None:
        raise UserError("--decoder and --bands are both given. Leave one of the two out.")
    require_options_of_kind(
        "--bands" if bands is not None else "",
        {("",): photograph_only, ("--bands",): spectral_only},
    )
    if decoder is not None:
        require_options_of_kind("--decoder", {("",): not_decoding})
    if bands is not None:
        named: dict[str, Any] = {
            "psf": psf, "target": target, "pattern": pattern, "star": star, "white": white,
            "noise": noise, "border": border, "truth": truth, "calibration": calibration,
            "refines": refine,
        }  # fmt: skip
        shown_in = light or "D65"
        _reconstruct_cube(
            source, bands, named, (out, picture), shown_in, weight, force=force, as_json=json
        )
        return
    from labapp.files.output_paths import restoration_output_paths

    wavelength = None if wavelength_nm is None else wavelength_nm * 1e-9
    selected = (target, pattern, wavelength, frame, star, grey, readout)
    told: dict[str, Any] = {
        "noise": noise, "border": border, "clip": clip, "dark": dark, "blind": blind,
        "truth": truth, "encoding": encoding,
    }  # fmt: skip
    if decoder is not None:
        _decode_photograph_file(
            source, decoder, selected, told, (out, picture), force=force, as_json=json
        )
        return
    places = restoration_output_paths(
        source, out, picture, (psf, truth), blind=blind is not None, force=force
    )
    use_one_thread()
    from labapp.pictures.reconstructing.command import OutputFiles
    from labapp.pictures.reconstructing.command import reconstruct_photograph as restore
    from labapp.pictures.reconstructing.method_choice import MethodChoice
    from labapp.pictures.reconstructing.recorded_photograph import RecordSelection
    from labapp.pictures.reconstructing.restoration_request import RestorationRequest

    asked = RestorationRequest(source, psf, RecordSelection(*selected), **told)
    restore(
        asked, MethodChoice(method, budget, weight, refine_psf), OutputFiles(*places), as_json=json
    )


def _decode_photograph_file(
    source: Path,
    decoder: str,
    selected: tuple[Any, ...],
    told: dict[str, Any],
    outputs: tuple[Path | None, Path | None],
    *,
    force: bool,
    as_json: bool,
) -> None:
    """Decode a photograph that was taken through a trained pattern, and write its files."""
    from labapp.files.output_paths import restoration_output_paths

    out = outputs[0] or source.with_name(f"{source.stem}_decoded.tiff")
    inputs = (told["truth"], Path(decoder))
    places = restoration_output_paths(source, out, outputs[1], inputs, blind=False, force=force)
    use_one_thread()
    from labapp.pictures.reconstructing.command import OutputFiles, decode_for_command
    from labapp.pictures.reconstructing.decoding_request import DecodingRequest
    from labapp.pictures.reconstructing.recorded_photograph import RecordSelection
    from labapp.pictures.reconstructing.restoration_request import RestorationRequest

    photograph = RestorationRequest(source, None, RecordSelection(*selected), **told)
    decode_for_command(DecodingRequest(photograph, decoder), OutputFiles(*places), as_json=as_json)


def _reconstruct_cube(
    source: Path,
    bands: str,
    named: dict[str, Any],
    outputs: tuple[Path | None, Path | None],
    light: str,
    weight: float | None,
    *,
    force: bool,
    as_json: bool,
) -> None:
    """Restore the spectral cube of a record, and write its files."""
    from labapp.files.output_paths import spectral_output_paths
    from labapp.spectral.band_list import parse_bands

    wavelengths = parse_bands(bands)
    inputs = (named["psf"], named["truth"], named["calibration"])
    places = spectral_output_paths(source, *outputs, inputs, force=force)
    use_one_thread()
    from labapp.spectral.command import SpectralFiles, reconstruct_spectra
    from labapp.spectral.request import SpectralRequest

    request = SpectralRequest(source, wavelengths, **named)
    reconstruct_spectra(request, SpectralFiles(*places), light, weight, as_json=as_json)
