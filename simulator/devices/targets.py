"""A changer of the virtual bench's targets."""

from __future__ import annotations

from drivers.interfaces import Setting
from simulator.devices.base import SimulatedDevice


class SimulatedTargets(SimulatedDevice):
    """Simulate a changer that places one of the scene's targets before the camera.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock and its virtual world.

    Raises
    ------
    DeviceError
        If the bench has no virtual world.
    """

    model = "simulated target changer"
    role = "targets"
    by_hand = False

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the targets that can be placed."""
        return tuple(self._world.scene.targets)

    @property
    def current_target(self) -> str:
        """Return the name of the target before the camera."""
        return self._world.target

    def place(self, name: str) -> Setting[str]:
        """Place a target before the camera.

        Raises DeviceError if the scene has no such target.
        """
        self._faults.begin(f"place {name}", self.reply_time)
        if name not in self.names:
            raise self._refuse(
                f"place {name}", "no such target", f"Choose one of {', '.join(self.names)}"
            )
        self._world.target = name
        return Setting(name, name, self._clock.now())
