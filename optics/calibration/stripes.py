"""How much light stripes of two phases send into their first order."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

Array = NDArray[np.float64]

_REACH = 5.0
"""Standard deviations of the blur at which a stripe's phase is the one that was asked for."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)

_SPREAD = ((-math.sqrt(3.0), 1 / 6), (0.0, 2 / 3), (math.sqrt(3.0), 1 / 6))
"""Gauss-Hermite nodes, in standard deviations, of what isn't still."""


def first_order(step: Array, softness: float = 0.0, ripple: float = 0.0) -> Array:
    """Light in a first order of equally wide stripes, over its most; sin²(step / 2) if hard.

    step: radians between the two phases, any shape. softness: standard deviation of the blur
    that neighbours give the phase, over the grating's period. ripple: standard deviation of the
    phase within an exposure or a filter's band, as a share of the phase.

    Where stripes are blurred the phase passes through all values between the two. Both edges
    of a stripe are mirror images, and their light cancels to first order in the softness.
    """
    return first_order_and_slope(step, softness, ripple)[0]


def first_order_and_slope(
    step: Array, softness: float = 0.0, ripple: float = 0.0
) -> tuple[Array, Array]:
    """first_order(), and its derivative with the step."""
    step = np.asarray(step, dtype=np.float64)
    light, slope = np.zeros(step.shape), np.zeros(step.shape)
    for node, weight in _SPREAD if ripple else ((0.0, 1.0),):
        stretch = 1 + node * ripple
        amplitude, change = _amplitude(step * stretch, softness)
        light += weight * amplitude**2
        slope += weight * 2 * amplitude * change * stretch
    return light, slope


def _amplitude(step: Array, softness: float) -> tuple[Array, Array]:
    """2π ∫ sin(step (h - ½)) sin 2πt dt over a quarter of a period, from an edge to a stripe's
    middle, where h goes from ½ to 1; and its derivative with the step."""
    if softness == 0:
        return np.sin(step / 2), np.cos(step / 2) / 2
    edge = min(_REACH * softness, 0.25)
    t = edge * (_NODES + 1) / 2
    risen, top = _risen(t, softness), float(_risen(np.array(0.25), softness))
    weight = math.pi * edge * _WEIGHTS * np.sin(2 * math.pi * t)
    rest = math.cos(2 * math.pi * edge)
    angle = step[..., None] * risen
    amplitude = np.sin(angle) @ weight + rest * np.sin(step * top)
    return amplitude, np.cos(angle) @ (weight * risen) + rest * top * np.cos(step * top)


def _risen(t: Array, softness: float) -> Array:
    """The blurred stripes' height less ½, at t periods from a rising edge."""
    unit = math.sqrt(2) * softness
    height = np.full(t.shape, -0.5)
    for period in (-1, 0, 1):
        height = height + 0.5 * (erf((t - period) / unit) - erf((t - period - 0.5) / unit))
    return height
