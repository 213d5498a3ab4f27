"""An evenly lit field."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from simulator.scene.drawable import UniformLight
from simulator.scene.target import Layer, Part, Target


@dataclass(frozen=True)
class Flat(Target):
    """An evenly lit field without an end: a diffuser that fills more than the frame.

    distance: metres; an even field has nothing to blur, but the blur is rendered, and is
    smallest in focus. radiance: W / (sr m² m).
    """

    distance: float
    radiance: float

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        return (Layer(self.distance, (Part(self.reflected_radiance(), UniformLight()),)),)
