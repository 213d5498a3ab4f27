"""Devices of the virtual bench, which speak the drivers' interfaces in-process.

In the order in which light meets them: `targets`, `filters`, `slm` and `simulated_camera`;
the `spectroradiometer` stands beside. What they share is in `base`.
"""

from simulator.devices.filters import SimulatedFilter as SimulatedFilter
from simulator.devices.filters import SimulatedWheel as SimulatedWheel
from simulator.devices.simulated_camera import SimulatedCamera as SimulatedCamera
from simulator.devices.slm import SimulatedSLM as SimulatedSLM
from simulator.devices.spectroradiometer import (
    SimulatedSpectroradiometer as SimulatedSpectroradiometer,
)
from simulator.devices.targets import SimulatedTargets as SimulatedTargets
