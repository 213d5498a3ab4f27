"""A blurred picture with the state of its pixels, and with its PSF: a restoration problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.files.picture.photograph import Light
from labapp.files.picture.photograph_writing import encode_photograph
from labapp.pictures.analysis.colour_filters import ColourFilters
from labapp.pictures.analysis.score import ReferencePicture
from optics.inverse.blur import Border
from optics.inverse.observation import Observation
from optics.inverse.observation_builder import build_observation
from optics.inverse.verdict import PSFScale, find_psf_scale

WHITE_PERCENTILE = 99.9
"""Percentile of a picture that counts as white, where nothing else says what white is."""


@dataclass(frozen=True, eq=False)
class BlurredPicture:
    """A blurred picture, and what is known of it.

    light: (bands, rows, columns); NaN where a pixel is dead. With colour filters, the light behind
        them, (1, rows, columns).
    clipped: pixels whose well was full, of the same shape as `light`.
    source: where the picture is from, in words.
    unit: unit of the light, in words.
    full_scale: light of the highest level of a written .png; None for white.
    is_srgb: whether a written .png has the 8 bits of sRGB.
    noise: standard deviation of a pixel. None to estimate it from the picture, because it includes
        what PSF and model can't explain; the estimate is at least `noise_floor`.
    border: what the scene does beyond the frame.
    notes: remarks for the user.
    noise_floor: noise that is known to be there, for example of photons.
    reference: what a perfect restoration would give, if known.
    planned_iterations: iterations by the name of a method, where the plan states them.
    filters: colour filters of the sensor, through which all bands are restored together.
    variance: of each pixel, of the same shape as `light`; infinite where nothing was measured. None
        if it isn't known.
    encoding: how the file's numbers stand for light, and who says so, in words; empty for records.
    """

    light: Light
    clipped: NDArray[np.bool_]
    source: str
    unit: str
    full_scale: float | None = None
    is_srgb: bool = True
    noise: float | None = None
    border: Border = "unknown"
    notes: tuple[str, ...] = ()
    noise_floor: float = 0.0
    reference: ReferencePicture | None = None
    planned_iterations: Mapping[str, int] = field(default_factory=dict)
    filters: ColourFilters | None = None
    variance: NDArray[np.floating] | None = None
    encoding: str = ""

    @property
    def band_count(self) -> int:
        """Return the number of bands that are restored."""
        return len(self.light) if self.filters is None else self.filters.response.shape[1]

    def with_psf(
        self, psf: Light, psf_source: str, notes: Sequence[str] = ()
    ) -> RestorationProblem:
        """Pose the restoration with this PSF; `notes` are further remarks for the user."""
        known = {one.name: getattr(self, one.name) for one in fields(BlurredPicture)}
        known["notes"] = (*self.notes, *notes)
        return RestorationProblem(**known, psf=psf, psf_source=psf_source)

    @cached_property
    def blurred_bands(self) -> Light:
        """Return the bands before their restoration; behind colour filters they are estimated."""
        if self.filters is None:
            return self.light
        noise = self.noise_floor if self.noise is None else self.noise
        return self.filters.separate(self.light[0], noise, self.clipped[0])

    def to_screen(self, light: Light) -> Light:
        """Convert bands to those of a screen: linear sRGB, or grey."""
        return light if self.filters is None else self.filters.to_screen(light)

    def screen_picture(self, light: NDArray[np.floating]) -> NDArray[np.float32]:
        """Convert bands for a screen, white at 1: (rows, columns), or (rows, columns, 3)."""
        shown: Light = self.to_screen(light.astype(np.float32)) / np.float32(self.white)
        return shown[0] if len(shown) == 1 else np.moveaxis(shown, 0, -1)

    def encode_file(self, path: Path, light: Light) -> bytes:
        """Return the bytes of the restored file, of the format of its ending.

        A .png holds what a screen shows, and other files hold the bands.
        """
        shown = self.to_screen(light) if path.suffix.lower() == ".png" else light
        full = self.white if self.full_scale is None else self.full_scale
        return encode_photograph(path, shown, self.is_srgb, full)

    def noise_source(self, noise: float) -> str:
        """Say whether the noise was given, computed or estimated."""
        if self.noise is not None:
            return "as told"
        return "of photons and read noise" if noise == self.noise_floor else "estimated"

    @cached_property
    def white(self) -> float:
        """Return the light that is drawn white, before and after restoration."""
        if self.full_scale is None and self.reference is not None:
            return self.reference.white
        if self.full_scale is not None and self.is_srgb:
            return self.full_scale
        bright = float(np.nanpercentile(self.blurred_bands, WHITE_PERCENTILE))
        return bright if bright > 0 else 1.0


@dataclass(frozen=True, eq=False)
class RestorationProblem(BlurredPicture):
    """A blurred picture with its PSF, to be restored.

    psf: (1 or bands, rows, columns), origin at n // 2; its sum is the share of light that arrives.
    psf_source: where it is from, in words.
    """

    psf: Light = field(kw_only=True)
    psf_source: str = field(kw_only=True)

    def observations(self) -> list[Observation]:
        """Return what each band shows; with colour filters, all bands in one observation."""
        if self.filters is not None:
            seen = self.filters.observation(
                self.light[0], self.psf, self.noise, self.border, self.clipped[0]
            )
            return [replace(seen, is_numpy=False, least_noise=self.noise_floor)]
        found = []
        for number, (light, clipped) in enumerate(zip(self.light, self.clipped, strict=True)):
            sound = np.isfinite(light)
            band = build_observation(
                torch.from_numpy(np.where(sound, light, 0)),
                self.psf[min(number, len(self.psf) - 1)],
                self.noise,
                self.border,
                weights=None if sound.all() else sound.astype(np.float32),
                clipped=clipped if clipped.any() else None,
            )
            found.append(replace(band, least_noise=self.noise_floor))
        return found

    @cached_property
    def psf_scales(self) -> tuple[PSFScale, ...]:
        """Find the scale of the PSF that each band shows."""
        if self.filters is not None:
            return ()
        return tuple(find_psf_scale(band) for band in self.observations())
