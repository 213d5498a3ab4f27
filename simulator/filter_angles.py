"""The angles at which light passes the filter before the lens, by where it lands on the sensor."""

from __future__ import annotations

import math

import numpy as np
import torch

from optics.camera import Camera
from optics.camera.ghost import ghost_field
from optics.light.bands import Band
from optics.plane import Plane


def largest_squared_sine(camera: Camera) -> float:
    """Return sin² of the angle at which light of the frame's corner passes the filter.

    A point's light comes along its chief ray, whose angle is the same on both sides of the lens'
    middle; that from the sides of the lens, of what is near, is left out. Light from beside the
    frame has the corner's angle, but for what distortion or a ghost bring into the frame.
    """
    half = [n * camera.sensor.pitch / 2 for n in camera.sensor.shape]
    beside = ghost_field(camera.ghosts, half)
    corner = math.hypot(*(side + more for side, more in zip(half, beside, strict=True)))
    by = camera.lens.radial_distortion
    if by is not None:
        corner = max(corner, float(by.undistorted(np.array(math.hypot(*half)))))
    return corner**2 / (corner**2 + float(camera.lens.image_distance) ** 2)


def squared_sines(camera: Camera, plane: Plane) -> torch.Tensor:
    """Return sin² of the angle at the filter by the light's place, (rows, columns)."""
    y, x = plane.mesh()
    squared = y**2 + x**2
    return squared / (squared + camera.lens.image_distance**2)


def some_angles(camera: Camera, band: Band, count: int) -> list[float]:
    """Return values of sin² at the filter over the frame, that of the axis first.

    They are evenly spaced, or that of the axis alone for a band that doesn't shift.
    """
    if not band.shifts_with_angle:
        return [0.0]
    greatest = largest_squared_sine(camera)
    return [greatest * k / (count - 1) for k in range(count)]


def angle_nodes(greatest: float, count: int) -> list[float]:
    """Return values of sin² between which a filter's band is interpolated, from 0 to the greatest.

    They are Chebyshev points of the second kind; a single one is that of the axis.
    """
    if count == 1:
        return [0.0]
    return [greatest * (1 - math.cos(math.pi * k / (count - 1))) / 2 for k in range(count)]
