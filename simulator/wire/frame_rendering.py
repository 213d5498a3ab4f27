"""Pictures of the virtual bench for a `FakeGigECamera`."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from simulator.world import World


def frame_renderer(world: World) -> Callable[[float, float], NDArray[np.uint16]]:
    """Return the `render` function that shows the virtual bench to a `FakeGigECamera`.

    The function takes an exposure in seconds and a gain in decibels. Each picture has its own noise
    and shows the bench in its state at that time. Numbers that the gain raises above the sensor's
    full scale are clipped there.
    """
    # A running camera may request two frames at once, and the world has only one state.
    turn = threading.Lock()

    def render_frame(exposure: float, gain_db: float) -> NDArray[np.uint16]:
        with turn:
            stream, _ = world.stream(exposure)
            image = stream.frame(world.random_generator())
        if not gain_db:
            return image
        more = np.rint(image * 10 ** (gain_db / 20))
        return np.minimum(more, world.camera.sensor.full_scale).astype(np.uint16)

    return render_frame
