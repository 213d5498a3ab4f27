"""Steps, learning rates and averaging of a training."""

from __future__ import annotations

import math
from dataclasses import dataclass

from optics.validation import require_count, require_positive

_EARLY_STEPS = 10
"""Steps over which the mean of the weights forgets the start. Chosen, as is common."""


@dataclass(frozen=True)
class TrainingSchedule:
    """How long and how fast a training goes.

    first_rate: learning rate after the warm-up.
    last_rate: learning rate that half a cosine falls to at the end.
    warm_up: steps over which the rate grows linearly to `first_rate`.
    average_decay: decay of the running mean of the weights per step, 0 to 1. The mean is the
    result, because it varies less than the last weights.
    clip: largest norm of the gradient over all parameters: longer ones are shortened to it. None
    leaves them.
    validation_interval: steps between two validations; there is one after the last step, too.
    seed: not negative.
    """

    steps: int
    first_rate: float
    last_rate: float
    warm_up: int = 0
    average_decay: float = 0.999
    clip: float | None = None
    validation_interval: int = 500
    seed: int = 1

    def __post_init__(self) -> None:
        require_count("steps", self.steps)
        require_count("validation_interval", self.validation_interval)
        require_positive("first_rate", self.first_rate, "")
        if not 0 <= self.last_rate <= self.first_rate:
            raise ValueError(
                f"last_rate is {self.last_rate}; choose 0 to first_rate, {self.first_rate}"
            )
        if self.warm_up < 0:
            raise ValueError(f"warm_up is {self.warm_up}; choose 0 or more steps")
        if not 0 <= self.average_decay < 1:
            raise ValueError(f"average_decay is {self.average_decay}; choose 0 to below 1")
        if self.clip is not None:
            require_positive("clip", self.clip, "")
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}; choose 0 or more")

    def rate(self, step: int) -> float:
        """Return the learning rate of a step, numbered from 0."""
        if step < self.warm_up:
            return self.first_rate * (step + 1) / (self.warm_up + 1)
        share = (step - self.warm_up) / (self.steps - self.warm_up)
        height = (1 + math.cos(math.pi * share)) / 2
        return self.last_rate + (self.first_rate - self.last_rate) * height

    def decay(self, updates: int) -> float:
        """Return the decay of the mean of the weights at an update, numbered from 1.

        It grows to `average_decay`, so that the weights before training are soon forgotten.
        """
        return min(self.average_decay, updates / (updates + _EARLY_STEPS))
