"""Scores of a restored cube against the true one: PSNR, SSIM, spectral angle, colour difference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from labapp.common.errors import UserError
from labapp.files.cubes import SpectralCube
from labapp.files.wavelengths import list_nanometres
from labapp.pictures.analysis.score import Score, score_present
from labapp.spectral.colour import colour_difference, describe_interpolation
from labapp.spectral.lights import ViewingLight
from optics.metrics import spectral_angle
from optics.threads import single_threaded

PEAK = 1.0
"""Peak of PSNR and data range of SSIM: white, in cubes of shares of white."""

LEAST_NORM = 0.1
"""Length of a true spectrum that a pixel must exceed for its spectral angle to count, in shares of
white: spectra of black things are noise."""

_SAME_WAVELENGTH = 5e-10  # metres; largest difference of bands that are compared


@dataclass(frozen=True)
class CubeScores:
    """How far a cube is from the true one, over the whole frame.

    bands: PSNR in dB (peak 1) and SSIM (data range 1) of each band.
    angle: mean spectral angle in degrees, over pixels whose true spectrum is longer than
        `LEAST_NORM`; NaN if there are none.
    difference, largest_difference: mean CIEDE2000 over all pixels, and its 95th percentile.
    light: name of the light in which colours are compared.
    interpolation: how the spectra were interpolated for that, in words.
    missing: pixels that the true cube lacks, which are left out.
    """

    bands: tuple[Score, ...]
    angle: float
    difference: float
    largest_difference: float
    light: str
    interpolation: str
    missing: int = 0

    @property
    def crop(self) -> str:
        """Say in words which pixels count."""
        left_out = f" but for {self.missing} missing pixels" if self.missing else ""
        return f"full frame{left_out}"

    @property
    def psnr(self) -> float:
        """Return the mean PSNR of the bands in dB."""
        return float(np.mean([one.psnr for one in self.bands]))

    @property
    def ssim(self) -> float:
        """Return the mean SSIM of the bands; NaN for pictures smaller than its window."""
        return float(np.mean([one.ssim for one in self.bands]))

    @property
    def as_data(self) -> dict[str, Any]:
        """Return the scores for JSON, with what they were computed over."""
        named = {
            "psnr_db": self.psnr,
            "ssim": self.ssim,
            "spectral_angle_deg": self.angle,
            "ciede2000": self.difference,
            "ciede2000_95_percent": self.largest_difference,
        }
        return {name: value if math.isfinite(value) else None for name, value in named.items()} | {
            "bands": [one.as_data for one in self.bands],
            "peak": PEAK,
            "crop": self.crop,
            "missing_pixels": self.missing,
            "least_norm": LEAST_NORM,
            "light": self.light,
            "interpolation": self.interpolation,
        }


@single_threaded
def score_cube(cube: SpectralCube, truth: SpectralCube, light: ViewingLight) -> CubeScores:
    """Score a cube against the true one: each band's PSNR and SSIM, the spectral angle, CIEDE2000.

    Raises UserError if the cubes have other bands, pixels or units than each other, or the true one
    lacks a value at every pixel. Both must be in shares of white; colours are compared in `light`.
    """
    require_same_kind(cube, truth)
    missing = cube.missing | truth.missing
    if missing.all():
        raise UserError("the true cube lacks a value at every pixel. Give one with light in it")
    bands = tuple(
        score_present(one, other, missing, PEAK)
        for one, other in zip(cube.values, truth.values, strict=True)
    )
    seen, wanted = (np.asarray(one.values)[:, ~missing][:, None] for one in (cube, truth))
    bright = np.linalg.norm(wanted, axis=0).max() > LEAST_NORM
    angle = spectral_angle(seen, wanted, LEAST_NORM) if bright else math.nan
    apart = colour_difference(cube, truth, light)[~missing]
    return CubeScores(
        bands,
        angle,
        float(apart.mean()),
        float(np.percentile(apart, 95)),
        light.name,
        describe_interpolation(cube.wavelengths),
        int(missing.sum()),
    )


def require_same_kind(cube: SpectralCube, truth: SpectralCube) -> None:
    """Raise UserError unless two cubes have the same bands, pixels and unit."""
    if cube.shape != truth.shape:
        is_, wanted = (" x ".join(map(str, one.shape)) for one in (truth, cube))
        raise UserError(f"the true cube is {is_} (bands, rows, columns); it must be {wanted}")
    apart = np.abs(np.subtract(cube.wavelengths, truth.wavelengths))
    if (apart > _SAME_WAVELENGTH).any():
        raise UserError(
            f"the true cube has bands at {list_nanometres(truth.wavelengths)}; they must be at "
            f"{list_nanometres(cube.wavelengths)}"
        )
    if cube.unit != truth.unit:
        raise UserError(
            f"the true cube is in {truth.unit!r}, and the restored one in {cube.unit!r}. Give both "
            "in one unit"
        )
