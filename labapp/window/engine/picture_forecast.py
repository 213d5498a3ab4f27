"""In how many seconds the next picture is expected."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from labapp.prediction.simulating.picture_time import seconds_per_operation
from optics.accuracy import MachineSpeed

if TYPE_CHECKING:
    from simulator.world import World


class PictureForecast:
    """Predict the time of simulated live pictures from their effect plans.

    The first prediction assumes the default machine; later ones follow the pictures that were
    computed since.
    world: that of a simulated camera.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._rate = seconds_per_operation(MachineSpeed())
        self._work = self._planned = 0.0
        self.last_seconds: float | None = None
        """Seconds of the last picture, its plan included; None before the first one."""

    def expected_seconds(self, exposure: float) -> float | None:
        """Return the seconds that the picture of the bench's present state takes.

        The picture's effects are planned for that, which its simulation needs not do again. None if
        they can't be planned: taking the picture says why.
        """
        try:
            plan = self._world.imaging.plan(self._world.situation(exposure))
        except ValueError:
            return None
        self._work, self._planned = plan.work, time.monotonic()
        return self._rate * plan.work

    @contextmanager
    def learn(self) -> Iterator[None]:
        """Learn from a picture's time, its plan's included, unless it fails or is given up."""
        self._work, began = 0.0, time.monotonic()
        yield
        now = time.monotonic()
        self.last_seconds = now - began
        if self._work > 0:
            self._rate = (now - self._planned) / self._work
