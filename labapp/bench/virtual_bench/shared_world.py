"""One virtual world that the threads of several wires set and look at."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Clock
from labapp.common.console import print_message
from simulator.wire.frame_rendering import frame_renderer
from simulator.world import World


class SharedWorld:
    """A world in which one instrument at a time changes anything.

    A picture is of the bench as it stands when its exposure begins. It is computed while others
    may go on: no instrument is silent for as long as the camera computes.
    """

    def __init__(self, world: World, clock: Clock) -> None:
        self._world, self.clock = world, clock
        self._turn, self._exposing = threading.RLock(), threading.Lock()
        self._frames = 0
        self._render = frame_renderer(world)
        self.before_frame: Callable[[], None] = lambda: None
        """Called before each picture: whoever must be asked what it shows does it here."""

    @contextmanager
    def exclusive_access(self) -> Iterator[World]:
        """The world, while nobody else changes it."""
        with self._turn:
            yield self._world

    def render_frame(self, exposure: float, gain_db: float) -> NDArray[np.uint16]:
        """The sensor's picture, as FakeGigECamera wants it; each has its own noise.

        What can't be computed is told to whoever started the bench: of the camera, only a frame
        is missing.
        """
        try:
            return self._expose(exposure, gain_db)
        except Exception as error:
            print_message(f"a picture of {exposure * 1e3:g} ms can't be made: {error}")
            raise

    def _expose(self, exposure: float, gain_db: float) -> NDArray[np.uint16]:
        with self._exposing:
            self.before_frame()
            with self._turn:
                self._frames += 1
                self._world.begin_frame(
                    0, 0, self._frames, index=self._frames, start_time=self.clock.now()
                )
            return self._render(exposure, gain_db)

    def radiance(self, wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
        """As World.radiance(): what a spectroradiometer looks at."""
        with self._turn:
            return self._world.radiance(wavelengths)

    def place(self, name: str) -> None:
        """Put a target before the camera; ValueError lists those that there are."""
        with self._turn:
            known = self._world.scene.targets
            if name not in known:
                raise ValueError(f"there is no target {name!r}; choose {', '.join(known)}")
            self._world.target = name

    def describe_state(self) -> str:
        """How the bench stands, in a line."""
        self.before_frame()
        with self._turn:
            band, grey = self._world.band, self._world.grey
            return (
                f"filter {band.centre * 1e9:.2f} nm, {band.fwhm * 1e9:g} nm wide; "
                f"SLM grey {grey.min()} to {grey.max()}, mean {grey.mean():.2f}; "
                f"target {self._world.target}; {self._frames} pictures taken"
            )
