"""A scene: targets by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from simulator.scene.target import Layer, Target


@dataclass(frozen=True)
class Dark(Target):
    """Target without any light: the lamp is off.

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


@dataclass(frozen=True)
class Scene:
    """Set of named targets, of which one stands before the camera at a time.

    Parameters
    ----------
    targets : mapping of str to Target, default a dark target
        The targets by name, at least one.

    Raises
    ------
    ValueError
        If there is no target.
    """

    targets: Mapping[str, Target] = field(default_factory=lambda: {"dark": Dark()})

    def __post_init__(self) -> None:
        if not self.targets:
            raise ValueError("targets is empty; a scene needs at least one")
