"""Devices of the virtual bench, which speak the drivers' interfaces in-process.

In the order in which light meets them: `targets`, `filters`, `slm` and `simulated_camera`;
the `spectroradiometer` stands beside. What they share is in `base`.
"""

from simulator.devices.filters import SimulatedFilter, SimulatedWheel
from simulator.devices.simulated_camera import SimulatedCamera
from simulator.devices.slm import SimulatedSLM
from simulator.devices.spectroradiometer import (
    SimulatedSpectroradiometer,
)
from simulator.devices.targets import SimulatedTargets

__all__ = [
    "SimulatedCamera",
    "SimulatedFilter",
    "SimulatedSLM",
    "SimulatedSpectroradiometer",
    "SimulatedTargets",
    "SimulatedWheel",
]
