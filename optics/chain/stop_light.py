"""Estimate the rounding error of a sum over the light in a chain's stop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

_ROUNDINGS = 4.0
"""Roundings of double precision that the field's error may amount to, over what they would be if
all errors in the stop added up. Chosen."""

PROBES = 10
"""Places along each axis of the stop at which the light there is sampled. Chosen."""


def probe_places(low: float, high: float) -> torch.Tensor:
    """Return the places between low and high at which a chain's light in the stop is sampled."""
    share = (np.arange(PROBES) + 0.5) * (math.sqrt(5) - 1) / 2 % 1
    return torch.from_numpy(low + (high - low) * share)


@dataclass(frozen=True)
class StopProbes:
    """Holds fields of a panel's pixels at places in a chain's stop, along an axis.

    fields: (places, pixels). turns: phases of the paths from the pixels, (places, pixels).
    independent: number of rows, or of nodes, whose errors are independent.
    """

    fields: torch.Tensor
    turns: torch.Tensor
    independent: int

    @property
    def light(self) -> torch.Tensor:
        """The mean light of each pixel in a chain's stop."""
        return (self.fields.real**2 + self.fields.imag**2).mean(0)

    @property
    def noise(self) -> torch.Tensor:
        """The mean square of each pixel's errors in a chain's stop, in roundings."""
        light = self.fields.real**2 + self.fields.imag**2
        # The share of the phase, pi per turn, is chosen, too.
        return (light * (1 + math.pi * self.turns) ** 2).mean(0) / self.independent


class StopLight:
    """Samples a chain's light in the stop, and estimates the rounding of its integral.

    A pixel's field in the stop is known to some roundings of its value and of its phase in radians;
    these errors are independent from row to row, or from node to node. Sums of products are known
    to some roundings of their value. By Schwarz' inequality, the integral of an error over the stop
    is at most the root of the stop's area times that of its mean square.

    y, x: the light along both axes. area: of the stop. box: of the rectangle that is probed.
    """

    def __init__(self, y: StopProbes, x: StopProbes, area: float, box: float) -> None:
        self._fields = y.fields, x.fields
        self._light, self._noise = (y.light, x.light), (y.noise, x.noise)
        self._scale = _ROUNDINGS * float(np.finfo(np.float64).eps) * math.sqrt(area * box)

    @property
    def even_error(self) -> float:
        """The error of the field at a sample of the chain's sensor, for an evenly lit panel."""
        (y, x), (down, along) = (tuple(map(torch.sum, one)) for one in (self._light, self._noise))
        return self._scale * float((y * x).sqrt() + (down * x + y * along).sqrt())

    def error(self, modulated: torch.Tensor) -> torch.Tensor:
        """Estimate the error of the field at a sample of a chain's sensor, (...), float64."""
        y, x = self._fields
        field = y @ modulated @ x.mT
        light = (field.real**2 + field.imag**2).mean((-2, -1))
        power = modulated.real**2 + modulated.imag**2
        (here, there), (down, along) = self._light, self._noise
        noise = (power @ there) @ down + (power @ along) @ here
        return self._scale * (light.sqrt() + noise.sqrt())
