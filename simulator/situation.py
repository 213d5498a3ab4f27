"""The situation of a picture: scene, camera, pattern, filter and exposure."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from typing import Any

from optics.camera import Camera, Lens, Panel
from optics.camera.pupil import object_to_lens_distance
from optics.light.bands import Band
from optics.polarisation import PathEffect
from optics.psf import nyquist_samples_per_pixel
from optics.sensor.readout import frame_duration
from simulator.filter_angles import largest_squared_sine
from simulator.focus import drifted_focus, focus_shifts, leaked_focus_shifts
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.probing.pattern_probe import PatternProbe, panel_without_effects
from simulator.probing.picture_probe import PictureProbe
from simulator.scene.target import Target


@dataclass(eq=False)
class SituationCache:
    """Results that were computed for a situation; they are deleted with it.

    picture_probe, pattern_probe: None until needed. are_estimates: whether the results are
    estimates; else they are bounds. results: all others, under the arguments that they depend on.
    """

    picture_probe: PictureProbe | None = None
    pattern_probe: PatternProbe | None = None
    are_estimates: bool = False
    results: dict[Hashable, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Situation:
    """All that a picture, and each decision about its effects, may depend on.

    camera: the real one. exposure_start, exposure: seconds; with a rolling shutter, those of the
    first row. path: what polariser, panel and splitter do to the two polarisations, or None where
    the bench doesn't say. numerics: relative error that numerical methods may make. cache: results
    that were computed for this situation.
    """

    camera: Camera
    mount: Mount
    target: Target
    band: Band
    panel_content: PanelContent
    exposure_start: float
    exposure: float
    path: PathEffect | None = None
    numerics: float = 1e-3
    cache: SituationCache = field(default_factory=SituationCache, init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", self.target.for_camera(self.camera))

    @property
    def wavelength(self) -> float:
        """Return the centre of the filter's band, in metres."""
        return self.band.centre

    @property
    def interference(self) -> complex:
        """Return how strongly unmodulated light interferes; 0 where the path isn't known."""
        return complex(self.path.interference) if self.path is not None else 0j

    @property
    def exposure_span(self) -> float:
        """Return the seconds from the first row's start of exposure to the last row's end."""
        return frame_duration(self.camera.sensor, self.exposure)

    @property
    def image_motion(self) -> float:
        """Return how far a moving target's image travels at most, metres on the sensor.

        It is that of the nearest part of the target.
        """
        scale = self.camera.magnification(min(self.picture_probe.distances))
        return math.hypot(*self.target.velocity) * scale * self.exposure_span

    @property
    def image_shift(self) -> float:
        """Return how far a shift of the panel moves images at most, metres on the sensor.

        It is that of the part of the target that is farthest from focus.
        """
        distances = {min(self.picture_probe.distances), max(self.picture_probe.distances)}
        moved = max(math.hypot(*self.mount.image_shift(self.camera, one)) for one in distances)
        farthest = max(abs(one) for one in self.foci)
        return moved + math.hypot(*self.mount.shift) * farthest / self.camera.lens.image_distance

    @property
    def focus_drift(self) -> float:
        """Return the drift of focus in the middle of the exposure, metres behind the sensor."""
        middle = self.exposure_start + self.exposure / 2
        return drifted_focus(self.camera, middle, self.wavelength)

    @property
    def foci(self) -> tuple[float, ...]:
        """Return where the lens may form images, metres behind the sensor.

        They are those of the band's light, and the focus of a lens that is the same for all light.
        """
        return focus_shifts(*self._focusing)

    @property
    def leaked_foci(self) -> tuple[float, ...]:
        """Return the foci of light that leaks through the filter, metres behind the sensor."""
        return leaked_focus_shifts(*self._focusing)

    @property
    def _focusing(self) -> tuple[Lens, Band, Iterator[float], float]:
        """Return the lens, the band, the layers' distances to the lens and the drift of focus."""

        def distances() -> Iterator[float]:
            # Only a lens whose focus shifts needs them.
            for distance in {layer.distance for layer in self.target.layers}:
                yield object_to_lens_distance(self.camera, distance)

        return self.camera.lens, self.band, distances(), self.focus_drift

    @property
    def picture_probe(self) -> PictureProbe:
        """Return the probe of the target's unblurred picture."""
        if self.cache.picture_probe is None:
            middle = self.exposure / 2
            shift = (self.target.velocity[0] * middle, self.target.velocity[1] * middle)
            camera = self.mount.camera_in_panel_axes(self.camera)
            self.cache.picture_probe = PictureProbe(self.target, camera, self.band, shift)
        return self.cache.picture_probe

    @property
    def pattern_probe(self) -> PatternProbe:
        """Return the probe of the shown pattern's or video's PSFs."""
        if self.cache.pattern_probe is None:
            camera = self.mount.camera_in_panel_axes(self.camera)
            self.cache.pattern_probe = PatternProbe(
                camera, self.panel_content, self.wavelength, self.picture_probe.distances,
                foci=self.foci, leaked_foci=self.leaked_foci,
            )  # fmt: skip
        return self.cache.pattern_probe

    @property
    def ideal_panel(self) -> Panel:
        """Return the panel without any of its effects."""
        return panel_without_effects(self.camera.panel)

    @property
    def coarsest_sampling(self) -> int:
        """Return the fewest samples along a pixel that suffice, with 5 % to spare.

        They resolve the finest fringe of the light, which is that of the shortest wavelength.
        """
        shortest = self.band.support[0]
        if self.band.shifts_with_angle:
            steepest = largest_squared_sine(self.camera)
            shortest = self.band.at_angle(steepest).support[0]
        if self.band.leak:
            shortest = min(shortest, self.band.leak_range[0])
        return math.ceil(1.05 * nyquist_samples_per_pixel(self.camera, shortest))
