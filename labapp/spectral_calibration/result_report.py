"""Results as tables, and advice on what to do at the bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from labapp.common.console import out, print_message, print_table
from labapp.common.plain_text import shell_word
from labapp.files.spectra_file import SpectraFile
from labapp.spectral.refinement import format_estimate

_LARGE_RESIDUAL = 0.25
"""Residual of a star's picture, relative to it, from which the model counts as wrong. Chosen:
interpolation and a star's own size leave a tenth."""

_LARGE_CHANGE = 4.0
"""Difference from nominal, in standard deviations that the nominal model was given, from which it
is named."""

_MODEL_KEYS = {"psfs_ppm", "neutral_ppm", "covariance", "deviation", "zeroth_order", "response"}


def spectra_data(file: SpectraFile, paths: tuple[Path, ...]) -> dict[str, Any]:
    """Return the results as plain data, without the model's own numbers."""
    return file.model_dump(mode="json", exclude=_MODEL_KEYS) | {
        "advice": advice(file),
        "files": [str(one) for one in paths],
    }


def print_spectra(file: SpectraFile, paths: tuple[Path, ...]) -> None:
    """Print parameters, bands, advice, and how to use the file."""
    rows = [
        [one.name, *format_estimate(one.value, one.sigma, one.unit), f"{one.nominal:.4g}"]
        for one in file.parameters
    ]
    print_table("Spectral calibration", ["what", "found ", "", "nominal "], rows)
    heads = ["band ", "white, e/s ", "share of light ", "star's residual "]
    print_table("Bands", heads, band_rows(file))
    if file.transmission:
        heads = ["band ", "centre nm ", "width nm ", "W/(sr m²) ", "filter's transmission "]
        print_table("Light of the white sheet", heads, light_rows(file))
    print_message(f"transmission: {file.transmission_source}")
    for line in advice(file):
        print_message(line)
    for line in file.indeterminate:
        print_message(f"indeterminate: {line}")
    for path in paths:
        out.print(f"wrote {path}", soft_wrap=True)
    out.print(
        f"labapp reconstruct RUN.h5 --bands all --calibration {shell_word(paths[0])}",
        soft_wrap=True,
    )


def band_rows(file: SpectraFile) -> list[list[str]]:
    """Return a printed row for each band: light of white, share of light, star's residual."""
    return [
        [
            f"{one.wavelength_nm:g} nm",
            f"{one.white_e_per_s:.3g}",
            f"{one.light_share:.3f}",
            f"{one.star_residual:.1%}".replace("%", " %"),
        ]
        for one in file.bands
    ]


def light_rows(file: SpectraFile) -> list[list[str]]:
    """Return a printed row for each band on what the spectroradiometer saw."""
    rows = []
    for band, one in zip(file.bands, file.transmission, strict=False):
        known = "not known"
        if one.relative is not None and one.sigma is not None:
            known = f"{one.relative:.3f} ± {one.sigma:.3f}"
        rows.append(
            [
                f"{band.wavelength_nm:g} nm",
                f"{one.wavelength_nm:.1f}",
                f"{one.width_nm:.1f}",
                f"{one.radiance_w_sr_m2:.3g}",
                known,
            ]
        )
    return rows


def advice(file: SpectraFile) -> list[str]:
    """Return what to do at the bench, in sentences."""
    said = []
    wrong = [one for one in file.bands if one.star_residual > _LARGE_RESIDUAL]
    if wrong:
        listed = ", ".join(f"{one.wavelength_nm:g}" for one in wrong)
        said.append(
            f"The computed PSFs explain the star badly at {listed} nm. Calibrate the panel first "
            "(labapp calibrate), focus the star, or use the measured PSFs: labapp reconstruct "
            f"RUN.h5 --bands all --psf {shell_word(file.record)}"
        )
    moved = [
        one for one in file.parameters
        if one.unit == "px" and abs(one.value) > 1.0 + _LARGE_CHANGE * one.sigma
    ]  # fmt: skip
    if moved:
        said.append(
            f"{moved[0].name}: {moved[0].value:+.2f} px beside the other bands. Lens and filter "
            "displace colours; the calibration accounts for it."
        )
    return said
