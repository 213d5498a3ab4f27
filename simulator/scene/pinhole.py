"""A pinhole behind the filter."""

from __future__ import annotations

from dataclasses import dataclass

from simulator.scene.star import Star


@dataclass(frozen=True)
class Pinhole(Star):
    """A hole of a millimetre, lit from behind through the filter (thesis §5.6)."""

    diameter: float = 1e-3
    distance: float = 2.0
    radiance: float = 1e9
