"""Everything that a decision may look at: what stands, shines, is shown and looks."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

from optics.camera import Camera, Panel
from optics.light.bands import Band
from optics.polarisation import PathEffect
from optics.psf import nyquist_samples_per_pixel
from optics.sensor.shutter import frame_duration
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.probing.pattern_probe import PatternProbe, panel_without_effects
from simulator.probing.picture_probe import PictureProbe
from simulator.scene.target import Target

_TO_SPARE = 1.05
"""Over the samples that resolve the finest fringe."""


@dataclass(eq=False)
class SituationCache:
    """What was found of a situation, so that it is found once. It goes when the situation goes.

    picture_probe, pattern_probe: None until somebody asks, or brings what is known from another
    situation. results: to all other questions, by what they follow from.
    """

    picture_probe: PictureProbe | None = None
    pattern_probe: PatternProbe | None = None
    results: dict[Hashable, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Situation:
    """A picture that is about to be taken.

    camera: what it really is, with its sensor. mount: how the panel sits. target: what stands
    before it, with its light. band: what the filter passes. panel_content: on the panel.
    exposure_start, exposure: seconds; of a first row that is exposed in turn with others. path:
    what polariser, panel and splitter do to the two polarisations, where the bench says.
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
        """Metres, the band's centre."""
        return self.band.centre

    @property
    def exposure_span(self) -> float:
        """Seconds from the first row's beginning to the last one's end."""
        return frame_duration(self.camera.sensor, self.exposure)

    @property
    def image_motion(self) -> float:
        """Metres on the sensor that a moving target's image goes meanwhile, at most."""
        scale = self.camera.magnification(min(self.picture_probe.distances))
        return math.hypot(*self.target.velocity) * scale * self.exposure_span

    @property
    def picture_probe(self) -> PictureProbe:
        """What is known of the target's picture without any blur."""
        if self.cache.picture_probe is None:
            middle = self.exposure / 2
            shift = (self.target.velocity[0] * middle, self.target.velocity[1] * middle)
            self.cache.picture_probe = PictureProbe(self.target, self.camera, self.band, shift)
        return self.cache.picture_probe

    @property
    def pattern_probe(self) -> PatternProbe:
        """What is known of the PSF of what is shown."""
        if self.cache.pattern_probe is None:
            self.cache.pattern_probe = PatternProbe(
                self.camera, self.panel_content, self.wavelength, self.picture_probe.distances
            )
        return self.cache.pattern_probe

    @property
    def ideal_panel(self) -> Panel:
        """The panel without any of its effects."""
        return panel_without_effects(self.camera.panel)

    @property
    def coarsest_sampling(self) -> int:
        """Samples of the light in a pixel along each axis, that resolve the finest fringe of the
        shortest wavelength."""
        shortest = self.band.support[0]
        if self.band.leak:
            shortest = min(shortest, self.band.leak_range[0])
        return math.ceil(_TO_SPARE * nyquist_samples_per_pixel(self.camera, shortest))
