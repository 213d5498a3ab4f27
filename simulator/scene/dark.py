"""Nothing."""

from __future__ import annotations

from dataclasses import dataclass

from simulator.scene.target import Layer, Target


@dataclass(frozen=True)
class Dark(Target):
    """Nothing: the lamp is off."""

    distance: float = 2.0
    radiance: float = 0.0

    @property
    def layers(self) -> tuple[Layer, ...]:
        return (Layer(self.distance, ()),)
