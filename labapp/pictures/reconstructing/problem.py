"""What is to be restored, whatever it was read from: light, PSF, and what is known of pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from labapp.files.photograph_file import Light
from labapp.pictures.analysis.score import ReferencePicture
from optics.deconvolution.observation import Observation
from optics.deconvolution.observation_builder import build_observation
from optics.operators.blur import Border

_WHITE = 99.9
"""Percentile of a picture that is drawn white, where nothing says what white is."""


@dataclass(frozen=True, eq=False)
class RestorationProblem:
    """A blurred picture and its PSF.

    light: (bands, rows, columns), NaN where a pixel is dead. psf: (1 or bands, rows, columns),
    origin at n // 2; its sum is the share of light that arrives. clipped: of the same shape as
    light, where the well was full. unit: of the light, in words. full_scale: the light of a .png's
    highest level, None for white; is_srgb: whether that file has sRGB's 8 bits. noise: standard
    deviation of a pixel; if None estimated, for what PSF and model can't explain is in it as well,
    and no less than `noise_floor`, which is known to be there. source, psf_source: where the two
    are from, in words. notes: what a person should know. reference: the picture as it should be,
    where there is one. planned_iterations: iterations of methods, where somebody has planned them.
    """

    light: Light
    psf: Light
    clipped: NDArray[np.bool_]
    source: str
    psf_source: str
    unit: str
    full_scale: float | None = None
    is_srgb: bool = True
    noise: float | None = None
    border: Border = "unknown"
    notes: tuple[str, ...] = field(default=())
    noise_floor: float = 0.0
    reference: ReferencePicture | None = None
    planned_iterations: Mapping[str, int] = field(default_factory=dict)

    def observations(self) -> list[Observation]:
        """Each band by itself."""
        return [self._observation(number) for number in range(len(self.light))]

    def _observation(self, number: int) -> Observation:
        light, clipped = self.light[number], self.clipped[number]
        sound = np.isfinite(light)
        band = build_observation(
            np.where(sound, light, 0),
            self.psf[min(number, len(self.psf) - 1)],
            self.noise,
            self.border,
            weights=None if sound.all() else sound.astype(np.float32),
            clipped=clipped if clipped.any() else None,
        )
        known = self.noise is not None or band.noise >= self.noise_floor
        return band if known else replace(band, given_noise=self.noise_floor)

    def noise_source(self, noise: float) -> str:
        """How the noise that a band was taken to have is known, in words."""
        if self.noise is not None:
            return "as told"
        return "of photons and read noise" if noise == self.noise_floor else "estimated"

    @cached_property
    def white(self) -> float:
        """The light that is drawn white."""
        if self.full_scale is None and self.reference is not None:
            return self.reference.white
        if self.full_scale is not None and self.is_srgb:
            return self.full_scale
        bright = float(np.nanpercentile(self.light, _WHITE))
        return bright if bright > 0 else 1.0
