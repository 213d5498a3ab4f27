"""A scene target without light."""

from __future__ import annotations

from dataclasses import dataclass

from simulator.scene.target import Layer, Target


@dataclass(frozen=True)
class Dark(Target):
    """Scene target without any light: the lamp is off.

    Parameters
    ----------
    distance : float, default 2.0
        Distance from the panel in metres, positive; it has no effect on the picture.
    radiance : float, default 0.0
        Spectral radiance, W / (sr m² m); it has no effect on the picture.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    """

    distance: float = 2.0
    radiance: float = 0.0

    @property
    def layers(self) -> tuple[Layer, ...]:
        return (Layer(self.distance, ()),)
