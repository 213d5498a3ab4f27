"""What a camera behind the wire sees of the virtual bench."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from simulator.world import World


def frame_renderer(world: World) -> Callable[[float, float], NDArray[np.uint16]]:
    """Makes the sensor's picture of an exposure in seconds and a gain in decibels, with noise.

    For `FakeGigECamera`, with fresh pictures: each has its own noise, and is of the bench as it
    then stands. What a gain clips is clipped at the sensor's full scale.
    """
    # Two frames of a running camera may be asked for at once; the world has one state.
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
