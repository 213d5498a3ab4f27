"""The image's vibration on the sensor during an exposure, and how it blurs pictures."""

from __future__ import annotations

import math

import numpy as np
import torch

from optics.formation import rfft2_frequencies
from optics.plane import Plane
from simulator.situation import Situation


def image_vibration(s: Situation) -> float:
    """Return how far the image trembles during an exposure, metres rms along an axis.

    A vibration of frequency f and any phase leaves 1 - sinc²(f T) of its variance about the mean
    place in an exposure T: all of it over many periods, and little in a small part of one.
    """
    camera = s.camera
    if not camera.vibration:
        return 0.0
    periods = camera.vibration_frequency * s.exposure
    return camera.vibration * math.sqrt(max(1 - float(np.sinc(min(periods, 1e9))) ** 2, 0.0))


def vibration_transfer(plane: Plane, rms: float) -> torch.Tensor:
    """Return the transfer function of a normally distributed vibration, float32."""
    fy, fx = rfft2_frequencies(plane)
    return torch.exp(-2 * (math.pi * rms) ** 2 * (fy**2 + fx**2)).to(torch.float32)
