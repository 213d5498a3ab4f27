"""Coarse predictions, shown until the exact live picture is simulated."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from labapp.window.messages import LiveFrame
from optics.progress import Cancelled
from simulator.coarse_pictures import CoarsePictures

if TYPE_CHECKING:
    from optics.camera import Sensor
    from simulator.situation import Situation
    from simulator.world import World

log = logging.getLogger(__name__)

_LEAST_PIXELS = 1 << 17
"""Pixels of a sensor from which on a prediction comes clearly earlier than its picture. Chosen."""


class CoarsePrediction:
    """Predict live pictures of large sensors in a thread, while the exact ones are simulated.

    `show` is called with a frame that holds a prediction, and with a function that tells whether it
    is still wanted.
    """

    def __init__(self, world: World, show: Callable[[LiveFrame, Callable[[], bool]], None]) -> None:
        self._world, self._show = world, show
        self._pictures = CoarsePictures()
        self._thread = ThreadPoolExecutor(1, "coarse-prediction")

    def close(self) -> None:
        self._thread.shutdown(cancel_futures=True)

    def begin(self, labels: LiveFrame, is_wanted: Callable[[], bool]) -> None:
        """Begin to predict the picture of the bench's present state.

        Nothing is predicted for small sensors and those with colour filters, nor where the exact
        picture is planned already, since it then comes as soon.
        labels: holds the settings.
        """
        s = self._world.situation(labels.exposure)
        sensor = s.camera.sensor
        is_large = math.prod(sensor.shape) >= _LEAST_PIXELS
        if is_large and sensor.colour is None and not self._world.imaging.is_planned(s):
            self._thread.submit(self._predict, s, labels, is_wanted)

    def _predict(self, s: Situation, labels: LiveFrame, is_wanted: Callable[[], bool]) -> None:
        def check() -> None:
            if not is_wanted():
                raise Cancelled

        try:
            check()
            electrons = self._pictures.predict(s, check)
            image = _digital_numbers(electrons, s.camera.sensor)
        except Cancelled:
            return
        except Exception:
            # The exact picture comes all the same, or its error says what is wrong.
            log.warning("no coarse prediction", exc_info=True)
            return
        self._show(replace(labels, image=image), is_wanted)


def _digital_numbers(electrons: torch.Tensor, sensor: Sensor) -> NDArray[np.uint16]:
    """Return the frame, without noise, of coarse electrons on each pixel of a sensor."""
    held = electrons.clamp(max=sensor.full_well) / sensor.gain + sensor.black_level
    rows, columns = sensor.shape
    numbers = held.round().clamp(0, sensor.top_number).to(torch.float32).numpy()
    fine = cv2.resize(numbers, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(fine).astype(np.uint16)
