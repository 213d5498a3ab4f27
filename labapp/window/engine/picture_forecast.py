"""In how many seconds the window's next picture is expected."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labapp.prediction.simulating.picture_time import seconds_per_operation
from optics.accuracy import MachineSpeed

if TYPE_CHECKING:
    from simulator.world import World


class PictureForecast:
    """Predict the time of simulated live pictures from their effect plans.

    The first prediction assumes the default machine; later ones follow the pictures that were
    computed since. `world` is that of a simulated camera.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._rate = seconds_per_operation(MachineSpeed())
        self._work = 0.0

    def expected_seconds(self, exposure: float) -> float | None:
        """Return the seconds that the picture of the bench's present state takes in the window.

        The picture's effects are planned for that, which its simulation needs not do again. None
        if they can't be planned: taking the picture says why.
        """
        try:
            plan = self._world.imaging.plan(self._world.situation(exposure))
        except ValueError:
            return None
        self._work = plan.work
        return self._rate * plan.work

    def learn(self, seconds: float) -> None:
        """Learn from the time that the window's last expected picture took."""
        if self._work > 0:
            self._rate = seconds / self._work
