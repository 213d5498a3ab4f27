"""The problem of restoring a spectral cube: a coded snapshot with PSFs, response and truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from labapp.files.cubes import SpectralCube
from labapp.files.cubes.cube import SHARE_OF_WHITE
from labapp.spectral.band_response import BandResponse
from labapp.spectral.typical_spectra import typical_reflectances
from optics.inverse import build_mosaic_observation
from optics.inverse.blur import Border
from optics.inverse.mosaics import MosaicObservation
from optics.multispectral import SnapshotCalibration

WHITE_PERCENTILE = 99.9
"""Percentile of a cube's values that counts as white, where nothing white was recorded."""

Picture = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpectralProblem:
    """A coded snapshot with all that its restoration needs.

    rate: (rows, columns), electrons per second and pixel; NaN where a pixel is dead.
    clipped: (rows, columns), pixels whose light is at least `rate`.
    wavelengths: bands in metres, rising.
    psfs: (bands, rows, columns), origin at n // 2.
    response: what white gives in each band behind each filter.
    noise_floor: noise of a pixel that photons and readout alone cause, electrons per second.
    source, psf_source: where snapshot and PSFs are from, in words.
    noise: noise of a pixel in electrons per second; None to estimate it, because it includes what
        PSFs and model can't explain. The estimate is at least `noise_floor`.
    border: what the scene does beyond the frame.
    truth: (bands, rows, columns), true bands in electrons per second, where white is
        `response.band_levels` times one number.
    truth_source: where they are from, in words.
    given_truth: true cube from a file, in shares of white, in the place of `truth`.
    pitch: distance in metres between pixels.
    prior: what is known of the camera before the photograph refines it; None if it doesn't. Its
        response includes the share of the light that the PSFs pass.
    notes: remarks for the user.
    """

    rate: Picture
    clipped: NDArray[np.bool_]
    wavelengths: tuple[float, ...]
    psfs: Picture
    response: BandResponse
    noise_floor: float
    source: str
    psf_source: str
    noise: float | None = None
    border: Border = "unknown"
    truth: Picture | None = None
    truth_source: str = ""
    given_truth: SpectralCube | None = None
    pitch: float | None = None
    prior: SnapshotCalibration | None = None
    notes: tuple[str, ...] = ()

    @property
    def dead_pixels(self) -> NDArray[np.bool_]:
        """Return which pixels give no light of their own, (rows, columns)."""
        return ~np.isfinite(self.rate)

    @cached_property
    def observation(self) -> MosaicObservation:
        """Build the observation from which all bands are restored together."""
        sound = ~self.dead_pixels
        built = build_mosaic_observation(
            np.where(sound, self.rate, 0).astype(np.float32),
            self.response.pattern,
            self.psfs.astype(np.float32),
            channels=self.response.channels,
            response=self.response.shares.astype(np.float32),
            noise=self.noise,
            border=self.border,
            weights=None if sound.all() else sound.astype(np.float32),
            clipped=self.clipped if self.clipped.any() else None,
        )
        return replace(built, is_numpy=False, least_noise=self.noise_floor)

    @cached_property
    def spectra(self) -> NDArray[np.float64]:
        """Return typical spectra in the wanted bands, (samples, bands), white being 1."""
        return typical_reflectances(self.wavelengths)

    def white_level(self, restored: NDArray[np.floating]) -> float:
        """Return the light in electrons per second that is white in all restored bands.

        Without a white sheet, the brightest pixels of the true bands count as white, or those of
        the restored ones, (bands, rows, columns), if the truth isn't known.
        """
        if self.response.white is not None:
            return self.response.white
        known = self.equalised_truth
        bright = float(np.percentile(restored if known is None else known, WHITE_PERCENTILE))
        return bright if bright > 0 else 1.0

    @cached_property
    def equalised_truth(self) -> Picture | None:
        """Return the true bands in electrons per second, as if white were equal in all of them."""
        if self.truth is None:
            return None
        return self.truth / self.response.band_levels[:, None, None]

    def as_cube(
        self,
        bands: NDArray[np.floating],
        white: float,
        description: str,
        error: NDArray[np.floating] | None = None,
    ) -> SpectralCube:
        """Return bands, (bands, rows, columns), as a cube in shares of white.

        They, the half width `error` of their intervals and `white` are in electrons per second.
        """
        return SpectralCube(
            (bands / white).astype(np.float32),
            self.wavelengths,
            SHARE_OF_WHITE,
            pitch=self.pitch,
            description=description,
            error=None if error is None else (error / white).astype(np.float32),
        )
