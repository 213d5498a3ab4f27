"""Cameras that are small enough for the slow methods in judges.py."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from optics.camera import Camera, Lens, Panel, Sensor

# Tests are small; torch's threads would only wait for each other.
torch.set_num_threads(1)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240607)


@pytest.fixture
def small_camera() -> Camera:
    """32x24 coarse pixels, no stop in the way, no unmodulated light."""
    return Camera(
        Panel(shape=(24, 32), pitch=40e-6, fill_factor=0.81, unmodulated=0.0),
        Lens(focal_length=0.125, f_number=5.0, focus_distance=2.0),
        Sensor(shape=(20, 21), pitch=20e-6),
    )
