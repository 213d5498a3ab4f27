"""Waveforms: periodic changes of a lamp's light with time (flicker)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optics.validation import require_choice, require_positive

_Shape = Literal["constant", "sine", "square", "filament"]


@dataclass(frozen=True)
class Waveform:
    """Periodic factor by which a lamp's light changes with time, 1 on average.

    The shapes, with the period T = 1 / `frequency`:

    - "constant".
    - "sine": 1 + depth sin(2π t/T + phase).
    - "square": brighter for the share `duty` of a period, and 1 - depth for the rest: a dimmed
      diode.
    - "filament": a wire on the mains. It is heated by the square of the voltage, 1 - cos(2π t/T),
      and stores heat for many periods, so that its light is the integral of that, 1 - depth sin(2π
      t/T + phase), a quarter of a period late.

    Parameters
    ----------
    shape, frequency : {"constant", "sine", "square", "filament"}, float, default 100.0
        Shape of the curve, constant by default, and its frequency in Hz: twice that of the mains.
    depth, phase : float, default 0.0
        Depth of the modulation, 0 to 1, and phase at t = 0, radians.
    duty : float, default 0.5
        Share of a period in which a square wave is bright, between 0 and 1.

    Raises
    ------
    ValueError
        For another word, or a number outside of its range.
    """

    shape: _Shape = "constant"
    frequency: float = 100.0
    depth: float = 0.0
    phase: float = 0.0
    duty: float = 0.5

    def __post_init__(self) -> None:
        require_choice("shape", self.shape, get_args(_Shape))
        require_positive("frequency", self.frequency, "Hz")
        if not 0 <= self.depth <= 1:
            raise ValueError(f"depth is {self.depth:g}; light can't be negative: give 0 to 1")
        if not math.isfinite(self.phase):
            raise ValueError(f"phase is {self.phase:g} rad; it must be finite")
        if not 0 < self.duty < 1:
            raise ValueError(f"duty is {self.duty:g}; give a share between 0 and 1")

    @property
    def period(self) -> float:
        return 1 / self.frequency

    @property
    def is_constant(self) -> bool:
        """Whether the lamp never flickers."""
        return self.shape == "constant" or self.depth == 0

    @property
    def ripple(self) -> float:
        """The largest relative deviation from the mean."""
        if self.is_constant:
            return 0.0
        return max(self.depth, self._excess) if self.shape == "square" else self.depth

    def at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Compute the factor, light over its mean, at times in seconds."""
        turns = self._turns(time)
        if self.is_constant:
            return np.ones_like(turns)
        if self.shape == "square":
            return np.where(turns % 1 < self.duty, 1 + self._excess, 1 - self.depth)
        return 1 + self._sign * self.depth * np.sin(2 * np.pi * (turns % 1))

    def mean(self, start: ArrayLike, end: ArrayLike) -> NDArray[np.float64]:
        """Average the factor over intervals of time in seconds, exactly.

        Starts and ends broadcast. Where the two are the same, the answer is the value at that time.
        Raises ValueError if an interval ends before it starts, or a time isn't finite.
        """
        first = np.asarray(start, dtype=np.float64)
        length = np.asarray(end, dtype=np.float64) - first
        if np.any(length < 0) or not np.all(np.isfinite(length)):
            raise ValueError("an interval ends before it starts; give finite times, start first")
        if self.is_constant:
            return np.ones_like(length)
        if self.shape == "square":
            turns, span = self._turns(first) % 1, length * self.frequency
            # The deviation from the mean integrates to zero over a whole period.
            deviation = self._deviation(turns + span % 1) - self._deviation(turns)
            mean = 1 + deviation / np.where(span > 0, span, 1.0)
            return np.where(span > 0, mean, self.at(first))
        # The mean of a sine is the sine at the middle times a sinc of the length. This form doesn't
        # subtract large terms.
        half = length * self.frequency
        middle = self._turns(first) + half / 2
        swing = np.sin(2 * np.pi * (middle % 1)) * np.sinc(half)
        return 1 + self._sign * self.depth * swing

    @property
    def _sign(self) -> float:
        return -1.0 if self.shape == "filament" else 1.0

    @property
    def _excess(self) -> float:
        """The relative excess of a square wave over its mean, while it is bright."""
        return self.depth * (1 - self.duty) / self.duty

    def _turns(self, time: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(time, dtype=np.float64) * self.frequency + self.phase / (2 * np.pi)

    def _deviation(self, turns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Integrate a square wave, less its mean, from turn 0 on, in turns."""
        part = turns % 1
        bright = np.minimum(part, self.duty)
        return self._excess * bright - self.depth * (part - bright)
