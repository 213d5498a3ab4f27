"""How live pictures are simulated on a virtual bench; runs keep the scene's own."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simulator.world import World


class LiveTolerance:
    """Set the relative error of live pictures; nothing changes where the camera is real.

    Estimates decide about the effects of live pictures. `world` is that of the bench's simulated
    camera, or None. Records of runs say with which tolerance they were simulated, and by what it
    was decided, so that both are the scene's outside of `during_frame()`.
    """

    def __init__(self, world: World | None) -> None:
        self._world = world
        self._tol: float | None = None
        self._given_up = threading.Event()

    def set(self, tol: float | None) -> None:
        """Set the relative error of live pictures, from any thread.

        None is the scene's own. A picture that is being simulated is given up. Raises ValueError
        for a tolerance that isn't positive and finite.
        """
        if tol is not None and not 0 < tol < math.inf:
            raise ValueError(f"tolerance {tol:g}: give a positive number, as 1e-3")
        if self._world is not None and tol != self._tol:
            self._tol = tol
            self._given_up.set()

    @property
    def is_simulated(self) -> bool:
        """Return whether live pictures are simulated."""
        return self._world is not None

    @property
    def is_frame_given_up(self) -> bool:
        """Return whether the last live frame is given up for another tolerance."""
        return self._given_up.is_set()

    @contextmanager
    def during_frame(self) -> Iterator[None]:
        """Simulate pictures by estimates at the set tolerance while the block runs."""
        self._given_up.clear()
        if self._world is None:
            yield
            return
        imaging = self._world.imaging
        own = imaging.tol, imaging.decide_by
        imaging.tol, imaging.decide_by = self._tol or imaging.tol, "estimate"
        try:
            yield
        finally:
            imaging.tol, imaging.decide_by = own
