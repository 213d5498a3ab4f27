"""How all tests run, and cameras that are small enough for the slow methods in judges.py."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    import numpy as np

    from optics.camera import Camera

pytest_plugins = ["runner.plugin"]

# Tests are small, and as many run as there are cores: threads would only wait for each other.
# Set before any library reads them, here and in every process that a test starts; so nothing
# that computes is imported above.
for library in ("OMP", "MKL", "OPENBLAS"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")

# A shell's background job ignores Ctrl-C, and so would every process that a test starts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def rng() -> np.random.Generator:
    import numpy as np

    return np.random.default_rng(20240607)


@pytest.fixture
def small_camera() -> Camera:
    """32x24 coarse pixels, no stop in the way, no unmodulated light."""
    from optics.camera import Camera, Lens, Panel, Sensor

    return Camera(
        Panel(shape=(24, 32), pitch=40e-6, fill_factor=0.81, unmodulated=0.0),
        Lens(focal_length=0.125, f_number=5.0, focus_distance=2.0),
        Sensor(shape=(20, 21), pitch=20e-6),
    )
