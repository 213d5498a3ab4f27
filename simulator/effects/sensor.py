"""The sensor's effects: its pixels' area and its noises."""

from __future__ import annotations

import math

from simulator.effects.situation import Decision, Situation


def pixel_aperture(s: Situation, tol: float) -> Decision:
    """1 - sinc at half of the sensor's Nyquist frequency."""
    loss = 1 - math.sin(math.pi / 4) / (math.pi / 4)
    return Decision("pixel aperture", loss > tol, loss, "mean", "a pixel averages over its area")


def dark_current(s: Situation, tol: float) -> Decision:
    sensor = s.camera.sensor
    size = math.sqrt(sensor.dark_current * 1.0) / _noise_floor(s)
    why = f"{sensor.dark_current:g} electrons per second, against the noise of one read-out"
    return Decision("dark current", size > tol, size, "noise", why)


def shot_noise(s: Situation, tol: float) -> Decision:
    size = math.sqrt(s.camera.sensor.full_well / 2) / _noise_floor(s)
    return Decision("shot noise", size > tol, size, "noise", "photons arrive at random")


def read_noise(s: Situation, tol: float) -> Decision:
    size = s.camera.sensor.read_noise / (s.camera.sensor.gain / math.sqrt(12))
    return Decision("read noise", size > tol, size, "noise", "against the quantisation step's own")


def _noise_floor(s: Situation) -> float:
    sensor = s.camera.sensor
    return math.hypot(sensor.read_noise, sensor.gain / math.sqrt(12))
