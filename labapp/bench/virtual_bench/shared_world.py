"""One virtual world, shared among the threads that serve its instruments."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Clock
from labapp.common.console import print_message
from simulator.wire.fake_gige import frame_renderer
from simulator.world import World


class SharedWorld:
    """A virtual world that only one instrument at a time may change.

    A picture shows the bench as it is when the exposure begins. It is computed without the lock,
    so that the other instruments still answer while the camera computes.
    """

    def __init__(self, world: World, clock: Clock) -> None:
        self._world, self.clock = world, clock
        self._turn, self._exposing = threading.RLock(), threading.Lock()
        self._frames = 0
        self._render = frame_renderer(world)
        self.before_frame: Callable[[], None] = lambda: None
        """Called before each picture, for instance to copy the screen to the panel."""

    @contextmanager
    def exclusive_access(self) -> Iterator[World]:
        """Yield the world while no other thread changes it."""
        with self._turn:
            yield self._world

    def render_frame(self, exposure: float, gain_db: float) -> NDArray[np.uint16]:
        """Render a picture with its own noise for FakeGigECamera; `exposure` is in seconds.

        An error is printed for the user who serves the bench, because the camera's client sees
        only that a frame is missing.
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
        """Return the spectral radiance that a spectroradiometer sees.

        Units and shapes are those of `World.radiance`.
        """
        with self._turn:
            return self._world.radiance(wavelengths)

    def place(self, name: str) -> None:
        """Put a target in front of the camera.

        Raises ValueError, which lists the targets, for an unknown name.
        """
        with self._turn:
            known = self._world.scene.targets
            if name not in known:
                raise ValueError(f"there is no target {name!r}; choose {', '.join(known)}")
            self._world.target = name

    def describe_state(self) -> str:
        """Describe filter, SLM, target and pictures in one line."""
        self.before_frame()
        with self._turn:
            band, grey = self._world.band, self._world.grey
            return (
                f"filter {band.centre * 1e9:.2f} nm, {band.fwhm * 1e9:g} nm wide; "
                f"SLM grey {grey.min()} to {grey.max()}, mean {grey.mean():.2f}; "
                f"target {self._world.target}; {self._frames} pictures taken"
            )
