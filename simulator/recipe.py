"""The recipe of a picture: nodes on each axis of the image formation, and its stages."""

from __future__ import annotations

from dataclasses import dataclass, replace

from optics.camera import Panel
from optics.sensor import ShotNoise, Stages
from simulator.situation import Situation

SMALLEST_WINDOW = 64
"""Sensor pixels across the smallest window on which a PSF is rendered."""


@dataclass(frozen=True)
class Recipe:
    """What is rendered of a situation; the defaults render the simplest picture.

    Panel: `panel` has the data of the effects that are on. `dispersion`: whether each wavelength
    has a phase of its own, or that of the filter's centre. `crystal`: whether the liquid crystal's
    response between a video's frames counts. `interference`: whether unmodulated light interferes
    with modulated light.

    Axes: `wavelengths` in the band (Gauss nodes); `leak`, wavelengths outside the band; `depths`,
    nodes of distance; `places` along each axis of the field (Chebyshev nodes) for the stop's shadow
    on the panel, and `aberrated_places` for field aberrations; `angles` at which light passes the
    filter; `motion`, parts of the exposure. 0 leak nodes leave the leak out; 1 node of another axis
    leaves that axis out.

    Light: `occlusion`: whether near layers hide far ones at their blurred edges, or all light is
    added. `diffraction`: waves, or the geometric blur of the same wavefront. `orders` of the pixel
    grid on each side, by PSFs; `coarse_orders`: two on each side instead, on cells of pixels.
    `vignetting`: whether the light falls off towards the field's edge. `lamp`: whether the lamp's
    waveform counts. `rolling`: whether rows are exposed one after the other. `vibration`: whether
    the image trembles. `distortion`: whether the lens distorts the picture. `ghosts`: whether the
    lens' ghosts are added. `glare`: whether veiling glare is added. `dust`: whether dust casts
    shadows. `crosstalk`: whether neighbours collect some of a pixel's electrons. `speckle`: whether
    the light of rough objects speckles.

    Window: `window`, the PSF's side in sensor pixels; `samples_per_pixel`, samples of PSFs in a
    pixel along each axis; `picture_samples_per_pixel`, the same of the pictures before they are
    blurred, or as many as PSFs have if it is None. With fewer than those, finer detail is left out
    of the light.

    Sensor: the stages of the sensor, in the order of the physics.
    """

    panel: Panel
    window: int
    samples_per_pixel: int
    picture_samples_per_pixel: int | None = None
    dispersion: bool = False
    crystal: bool = False
    interference: bool = False
    wavelengths: int = 1
    leak: int = 0
    depths: int = 1
    occlusion: bool = False
    places: int = 1
    aberrated_places: int = 1
    angles: int = 1
    motion: int = 1
    diffraction: bool = False
    orders: int = 0
    coarse_orders: bool = False
    vignetting: bool = False
    lamp: bool = False
    rolling: bool = False
    axial_colour: bool = False
    lateral_colour: bool = False
    focus_drift: bool = False
    distortion: bool = False
    vibration: bool = False
    ghosts: bool = False
    pixel_aperture: bool = False
    glare: bool = False
    dust: bool = False
    mosaic: bool = False
    crosstalk: bool = False
    speckle: bool = False
    dark_current: bool = False
    fixed_pattern: bool = False
    shot: ShotNoise = "none"
    clipping: bool = False
    read_noise: bool = False
    quantisation: bool = False

    @staticmethod
    def minimal(s: Situation) -> Recipe:
        """Return the recipe of the simplest picture of a situation.

        It has an ideal panel and lens, one wavelength, place and time, and a sensor that counts
        electrons.
        """
        return Recipe(s.ideal_panel, SMALLEST_WINDOW, s.coarsest_sampling, 1)

    @property
    def light_samples_per_pixel(self) -> int:
        """Return the samples of blurred light along a pixel."""
        drawn = self.picture_samples_per_pixel or self.samples_per_pixel
        return light_samples(self.samples_per_pixel, drawn, occlusion=self.occlusion)

    @property
    def stages(self) -> Stages:
        """Return which of the sensor's stages are included."""
        return Stages(
            self.dark_current, self.fixed_pattern, self.shot,
            self.clipping, self.read_noise, self.quantisation,
        )  # fmt: skip

    def with_changes(self, **changes: object) -> Recipe:
        """Return a recipe with some fields changed."""
        return replace(self, **changes)  # type: ignore[arg-type]


def light_samples(of_psf: int, of_picture: int, *, occlusion: bool) -> int:
    """Return the samples of blurred light in a pixel along each axis.

    Where light is multiplied by what hides it, both need all their detail.
    """
    return of_psf if occlusion else min(of_picture, of_psf)
