"""Everything that a decision may look at: what stands, shines, is shown and looks."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

from optics.camera import Camera, Panel
from optics.light.bands import Band
from optics.polarisation import PathEffect
from optics.psf import nyquist_samples
from optics.sensor.shutter import span
from simulator.mount import Mount
from simulator.probing.pattern import PatternProbe, ideal
from simulator.probing.picture import PictureProbe
from simulator.scene.target import Target
from simulator.shown import Shown

_TO_SPARE = 1.05
"""Over the samples that resolve the finest fringe."""


@dataclass(eq=False)
class Facts:
    """What was found of a situation, so that it is found once. It goes when the situation goes.

    picture, pattern: None until somebody asks, or brings what is known from another situation.
    answers: to all other questions, by what they follow from.
    """

    picture: PictureProbe | None = None
    pattern: PatternProbe | None = None
    answers: dict[Hashable, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Situation:
    """A picture that is about to be taken.

    camera: what it really is, with its sensor. mount: how the panel sits. target: what stands
    before it, with its light. band: what the filter passes. shown: on the panel. moment,
    exposure: seconds; of a first row that is exposed in turn with others. path: what polariser,
    panel and splitter do to the two polarisations, where the bench says.
    """

    camera: Camera
    mount: Mount
    target: Target
    band: Band
    shown: Shown
    moment: float
    exposure: float
    path: PathEffect | None = None
    numerics: float = 1e-3
    facts: Facts = field(default_factory=Facts, init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", self.target.for_camera(self.camera))

    @property
    def wavelength(self) -> float:
        """Metres, the band's centre."""
        return self.band.centre

    @property
    def lasts(self) -> float:
        """Seconds from the first row's beginning to the last one's end."""
        return span(self.camera.sensor, self.exposure)

    @property
    def moved(self) -> float:
        """Metres on the sensor that a moving target's image goes meanwhile, at most."""
        scale = self.camera.magnification(min(self.picture.distances))
        return math.hypot(*self.target.velocity) * scale * self.lasts

    @property
    def picture(self) -> PictureProbe:
        """What is known of the target's picture without any blur."""
        if self.facts.picture is None:
            middle = self.exposure / 2
            shift = (self.target.velocity[0] * middle, self.target.velocity[1] * middle)
            self.facts.picture = PictureProbe(self.target, self.camera, self.band, shift)
        return self.facts.picture

    @property
    def pattern(self) -> PatternProbe:
        """What is known of the PSF of what is shown."""
        if self.facts.pattern is None:
            self.facts.pattern = PatternProbe(
                self.camera, self.shown, self.wavelength, self.picture.distances
            )
        return self.facts.pattern

    @property
    def ideal_panel(self) -> Panel:
        """The panel without any of its effects."""
        return ideal(self.camera.panel)

    @property
    def coarsest_sampling(self) -> int:
        """Samples of the light in a pixel along each axis, that resolve the finest fringe of the
        shortest wavelength."""
        shortest = self.band.support[0]
        if self.band.leak:
            shortest = min(shortest, self.band.leak_range[0])
        return math.ceil(_TO_SPARE * nyquist_samples(self.camera, shortest))
