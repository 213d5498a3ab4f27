"""An evenly lit field as a target."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from simulator.scene.drawable import UniformLight
from simulator.scene.target import Layer, Part, Target


@dataclass(frozen=True)
class Flat(Target):
    """Evenly lit field: a diffuser that fills more than the frame.

    Parameters
    ----------
    distance : float
        Distance from the panel in metres, positive. The blur has no effect on an even field, but
        it is rendered, and it is smallest in focus.
    radiance : float
        Spectral radiance, W / (sr m² m), not negative.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    """

    distance: float
    radiance: float

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        return (Layer(self.distance, (Part(self.reflected_radiance(), UniformLight()),)),)
