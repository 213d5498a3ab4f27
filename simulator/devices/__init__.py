"""Devices of the virtual bench, which implement the drivers' interfaces in this process.

The light meets them in the order `targets`, `filters`, `slm` and `simulated_camera`; the
`spectroradiometer` measures the target beside the camera. Their common code is in `base`.
"""

from simulator.devices.filters import SimulatedFilter, SimulatedWheel
from simulator.devices.simulated_camera import SimulatedCamera
from simulator.devices.slm import SimulatedSLM
from simulator.devices.spectroradiometer import SimulatedSpectroradiometer
from simulator.devices.targets import SimulatedTargets

__all__ = [
    "SimulatedCamera",
    "SimulatedFilter",
    "SimulatedSLM",
    "SimulatedSpectroradiometer",
    "SimulatedTargets",
    "SimulatedWheel",
]
