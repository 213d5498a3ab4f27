"""Simulated exposure brackets on which `labapp accuracy hdr` measures merges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from optics import hdr
from optics.camera import Sensor

Array = NDArray[np.float64]

_LEVELS = 48
"""Lights of the scene, evenly in their logarithm. Chosen."""

_BRIGHTEST = 0.8
"""Brightest light, over that which clips the shortest exposure. Chosen."""

_FULL_WELL = 1e6
"""Electrons: the converter ends first."""

_BLACK = 64.0
"""Digital number of no light."""


@dataclass(frozen=True)
class BracketCase:
    """Even light of many levels, and exposures whose times in seconds grow by one ratio.

    decades: of the light.
    darks: dark frames of each exposure.
    pixels: of each level.
    """

    frames: int
    ratio: float
    shortest: float
    decades: float
    darks: int
    bits: int
    gain: float
    read_noise: float
    pixels: int
    seed: int

    @property
    def name(self) -> str:
        """The bracket in words."""
        return (
            f"{self.frames} exposures, {self.shortest * 1e3:g} ms × {self.ratio:g}ⁿ, "
            f"{self.decades:g} decades"
        )

    @cached_property
    def times(self) -> Array:
        """Exposure times, seconds, the shortest first."""
        return np.asarray(self.shortest * self.ratio ** np.arange(self.frames, dtype=np.float64))

    @cached_property
    def sensor(self) -> Sensor:
        return Sensor(
            bits=self.bits, full_well=_FULL_WELL, gain=self.gain, read_noise=self.read_noise,
            dark_current=0.0, black_level=_BLACK,
        )  # fmt: skip

    @cached_property
    def rates(self) -> Array:
        """Light of each level, electrons per second, the dimmest first."""
        top = (self.sensor.full_scale - _BLACK) * self.gain / self.shortest
        return np.asarray(_BRIGHTEST * top * np.logspace(-self.decades, 0, _LEVELS))

    @cached_property
    def bracket(self) -> hdr.Bracket:
        """The exposures, (levels, pixels), with Poisson's and normal noise."""
        rng, shape = np.random.default_rng(self.seed), (_LEVELS, self.pixels)

        def draw_frame(light: Array | float) -> NDArray[np.uint16]:
            electrons = rng.poisson(light, shape) + rng.normal(0, self.read_noise, shape)
            number = np.round(electrons / self.gain + _BLACK)
            return np.clip(number, 0, 2**self.bits - 1).astype(np.uint16)

        frames = [draw_frame(self.rates[:, None] * time) for time in self.times]
        darks = [
            np.mean([draw_frame(0.0) for _ in range(self.darks)], axis=0).astype(np.float32)
            for _ in self.times
        ]
        counts = [self.darks] * self.frames
        return hdr.Bracket(frames, self.times, darks, counts, self.sensor)

    @cached_property
    def least_errors(self) -> Array:
        """Least relative error of each level that an estimate without bias can have."""
        variances = [hdr.cramer_rao_variance(self.bracket, rate) for rate in self.rates]
        return np.asarray(np.sqrt(variances) / self.rates)
