"""Kinds of restoration beside that by a PSF: a decoded photograph, and a spectral cube."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from labapp.common.errors import UserError
from labapp.common.threads import use_one_thread


def decode_photograph_file(
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


def reconstruct_cube(
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


def require_options_of_one_kind(
    bands: str | None, photograph_only: dict[str, Any], spectral_only: dict[str, Any]
) -> None:
    """Raise UserError for options that mean nothing to the kind of restoration."""
    if bands is not None:
        refuse_options("--bands", photograph_only)
        return
    given = next((name for name, value in spectral_only.items() if value is not None), None)
    if given is not None:
        raise UserError(
            f"{given}: means something with --bands only. Add --bands, or leave it out."
        )


def refuse_options(kind: str, refused: dict[str, Any]) -> None:
    """Raise UserError for an option that means nothing with another one, `kind`."""
    given = next((name for name, value in refused.items() if value is not None), None)
    if given is not None:
        raise UserError(f"{given}: means nothing with {kind}. Leave one of the two out.")
