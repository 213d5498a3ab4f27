"""A third party's camera, for a process of its own: its library hangs when it is told to."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from drivers.interfaces import Frame, Identity, Setting


class StrangeCamera:
    """Pictures of its frame number. hang: a file; while it exists, a capture never ends."""

    full_scale = 4095
    exposure_range = (1e-5, 30.0)
    frame_time = 0.001
    reply_time = 0.2
    settling = 0.0

    def __init__(self, surroundings, hang="never", shape=(64, 96)):
        self.shape = tuple(shape)
        self._clock, self._hang = surroundings.clock, Path(hang)
        self._exposure, self._number = 0.01, 0

    @property
    def identity(self):
        return Identity("strange camera", "13", simulated=False)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def make_safe(self):
        pass

    def set_exposure(self, exposure):
        self._exposure = exposure
        return Setting(exposure, exposure, self._clock.now())

    def capture(self, cancelled):
        if self._hang.exists():
            self._hang.write_text(str(os.getpid()))
            time.sleep(1e6)
        began = self._clock.now()
        self._clock.wait_until(began + self._exposure, cancelled)
        self._number += 1
        image = np.full(self.shape, self._number, np.uint16)
        return Frame(image, self._exposure, 2.6, began, self._number)
