"""What is rendered of a situation: the nodes on each axis, and the stages."""

from __future__ import annotations

from dataclasses import dataclass, replace

from optics.camera import Panel
from optics.sensor import ShotNoise, Stages
from simulator.situation import Situation

SMALLEST_WINDOW = 64
"""Sensor pixels across the smallest PSF that is rendered."""


@dataclass(frozen=True)
class Recipe:
    """The barest picture by default; effects that are on add to it.

    Panel: `panel` has the data of effects that are on; `dispersion` whether each wavelength has
    a phase of its own, or that of the filter's centre; `crystal` whether a video's frames are
    left on the way; `interference` whether unmodulated light beats with the rest.

    Axes: wavelengths in the band (Gauss nodes), wavelengths of the leak beside it, depth layers,
    places along each axis of the field (Chebyshev nodes), nodes of a motion within the exposure.
    0 of the leak is none; 1 of the others is one.

    Light: `occlusion` whether near things hide far ones at their blurred edges, or are added;
    `diffraction` it, or the geometric blur of the same wavefront; `orders` of the pixel grid on
    each side; `vignetting`; `lamp` whether the lamp's waveform weighs times and rows; `rolling`
    whether rows are exposed in turn; `glare` whether a part of the light veils all pixels.

    Window: PSF's side in sensor pixels, and samples of the light in a pixel along each axis;
    `picture_samples_per_pixel`: of pictures before they are blurred, if that is more.

    Sensor: in the order of the physics.
    """

    panel: Panel
    window: int
    samples_per_pixel: int
    picture_samples_per_pixel: int = 1
    dispersion: bool = False
    crystal: bool = False
    interference: bool = False
    wavelengths: int = 1
    leak: int = 0
    depths: int = 1
    occlusion: bool = False
    places: int = 1
    motion: int = 1
    diffraction: bool = False
    orders: int = 0
    vignetting: bool = False
    lamp: bool = False
    rolling: bool = False
    pixel_aperture: bool = False
    glare: bool = False
    mosaic: bool = False
    dark_current: bool = False
    fixed_pattern: bool = False
    shot: ShotNoise = "none"
    clipping: bool = False
    read_noise: bool = False
    quantisation: bool = False

    @staticmethod
    def minimal(s: Situation) -> Recipe:
        """An ideal panel and lens at one wavelength, place and time, and a sensor that counts
        electrons."""
        return Recipe(s.ideal_panel, SMALLEST_WINDOW, s.coarsest_sampling)

    @property
    def stages(self) -> Stages:
        """What of the sensor is done."""
        return Stages(
            self.dark_current,
            self.fixed_pattern,
            self.shot,
            self.clipping,
            self.read_noise,
            self.quantisation,
        )

    def with_changes(self, **changes: object) -> Recipe:
        """The same with some entries changed."""
        return replace(self, **changes)  # type: ignore[arg-type]
