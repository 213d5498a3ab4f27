"""A camera whose frames are ready: noise that differs by frame, and clipped pixels strewn in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

import numpy as np

from drivers.interfaces import Frame, Identity, Setting, Surroundings

_FRAMES = 8
"""Different frames, which come in turn: neighbours always differ."""

_MEAN, _SPREAD = 1200.0, 60.0
"""Mean and standard deviation of the pixels that aren't clipped, in DN."""


class NoiseCamera:
    """Gives frames as fast as they are fetched, so that it is never what a window waits for.

    rows, columns: of the frames. saturated: share of clipped pixels, elsewhere in each frame.
    """

    full_scale = 4095
    exposure_range = (1e-5, 30.0)
    frame_time = 0.0
    reply_time = 5.0

    def __init__(
        self, surroundings: Surroundings, rows: int, columns: int, saturated: float
    ) -> None:
        self.shape = (rows, columns)
        self._clock = surroundings.clock
        self._exposure, self._number = 0.01, 0
        self._frames = [self._frame(seed, saturated) for seed in range(_FRAMES)]

    @property
    def identity(self) -> Identity:
        return Identity("noise camera", "1", simulated=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def make_safe(self) -> None:
        pass

    def set_exposure(self, exposure: float) -> Setting[float]:
        self._exposure = exposure
        return Setting(exposure, exposure, self._clock.now())

    def capture(self, cancelled: Callable[[], bool]) -> Frame:
        self._number += 1
        image = self._frames[self._number % _FRAMES]
        return Frame(image, self._exposure, 2.6, self._clock.now(), self._number)

    def _frame(self, seed: int, saturated: float) -> np.ndarray:
        rng = np.random.default_rng(seed)
        image = rng.normal(_MEAN, _SPREAD, self.shape).astype(np.uint16)
        image[rng.random(self.shape) < saturated] = self.full_scale
        return image
