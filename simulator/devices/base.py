"""What all simulated devices share."""

from __future__ import annotations

import math
from typing import Self

from drivers.errors import DeviceError
from drivers.interfaces import Identity, Surroundings
from simulator.faults import FaultInjector
from simulator.world import World


def require_duration(name: str, milliseconds: float) -> None:
    """Raise ValueError if a duration is negative or not finite."""
    if not 0 <= milliseconds < math.inf:
        raise ValueError(f"{name} is {milliseconds}; it must be finite and not negative")


class SimulatedDevice:
    """World, clock and fault injector, as all simulated devices have them."""

    model = ""
    role = ""
    settling = 0.0
    reply_time = 0.5

    def __init__(self, surroundings: Surroundings) -> None:
        if not isinstance(surroundings.world, World):
            reply, remedy = "this bench has no virtual world", "Name a scene in the bench file"
            raise self._refuse("open", reply, remedy)
        self._world = surroundings.world
        self._clock = surroundings.clock
        self._faults = FaultInjector(self._world.faults, self.role, self.model, self._clock)

    @property
    def identity(self) -> Identity:
        """Return the model, marked as simulated."""
        return Identity(self.model, "simulated", simulated=True)

    def make_safe(self) -> None:
        """Do nothing; devices that have a safe state override this."""

    def kill(self) -> None:
        """End a call that hangs."""
        self._faults.kill()

    def __enter__(self) -> Self:
        self._faults.require_plugged()
        return self

    def __exit__(self, *error: object) -> None:
        self.make_safe()

    def _refuse(self, command: str, reply: str, remedy: str) -> DeviceError:
        """Return the DeviceError with which the device refuses a command."""
        return DeviceError(self.model, command, reply, remedy)
