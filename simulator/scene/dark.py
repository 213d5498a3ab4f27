"""Nothing."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.camera import Camera
from optics.formation import spectrum_of_samples
from optics.plane import Plane
from simulator.scene.target import Layer, Target


@dataclass(frozen=True)
class Dark(Target):
    """Nothing: the lamp is off."""

    distance: float = 2.0
    radiance: float = 0.0

    @property
    def layers(self) -> tuple[Layer, ...]:
        return (Layer(self.distance, ()),)

    def spectrum(self, plane: Plane, camera: Camera, wavelength: float) -> torch.Tensor:
        return spectrum_of_samples(torch.zeros(plane.shape, dtype=torch.float64))
