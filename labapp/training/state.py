"""Weights, their running mean and the optimiser, from which single steps are taken."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch

from labapp.training.processes import Processes
from labapp.training.task import RememberingTask, TrainingTask
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


class TrainingState:
    """The state from which a training goes on bit by bit as it would have.

    average: running mean of the weights, by their names in the module.
    step: steps so far, those that were skipped included.
    skipped: steps so far without a finite loss and gradient, which changed nothing.
    failures: how many of these were the last ones in a row.
    history: step and score of each validation.
    samples_computed: by this process, since the training was started or continued.
    """

    def __init__(
        self, task: TrainingTask, schedule: TrainingSchedule, processes: Processes
    ) -> None:
        if task.samples < processes.count:
            raise ValueError(
                f"samples is {task.samples} for {processes.count} processes; start fewer "
                "processes, so that each has a sample of every step"
            )
        for name, value in task.module.named_parameters():
            if value.dtype not in (torch.float32, torch.float64):
                raise ValueError(f"{name} is {value.dtype}; train in float32 or float64")
        self._task, self._schedule, self._processes = task, schedule, processes
        self._parameters = [one for one in task.module.parameters() if one.requires_grad]
        groups = [dict(one) for one in task.parameter_groups()]
        self._factors = [float(one.pop("rate")) for one in groups]
        # Not foreach: one parameter after the other computes the same on every machine.
        self._optimiser = torch.optim.Adam(groups, lr=schedule.first_rate, foreach=False)
        processes.share_weights(task.module)
        self.average = _copy_weights(task.module)
        self.step = self.skipped = self.failures = self.samples_computed = 0
        self.history: list[tuple[int, float]] = []

    def take_step(self) -> float:
        """Take a step, and return its mean loss over the samples of all processes.

        If the loss or the gradient isn't finite, the step is counted as skipped, and the weights
        stay as they are.
        """
        own = self._processes.own_samples(self._task.samples)
        self._optimiser.zero_grad(set_to_none=True)
        losses = self._task.losses(self.step, own)
        if losses.shape != (len(own),):
            raise ValueError(f"losses are {tuple(losses.shape)}; return one for each of {len(own)}")
        share = losses.sum() / self._task.samples
        share.backward()  # type: ignore[no-untyped-call]
        self.samples_computed += len(own)
        self._processes.sum_gradients(self._parameters)
        loss = self._processes.sum_number(share.item())
        self._apply_gradients(loss)
        self.step += 1
        return loss

    def validate(self) -> None:
        """Rate the averaged weights, and note the score in the history."""
        module = self._task.module
        own = _copy_weights(module)
        module.load_state_dict(self.average)
        try:
            with torch.no_grad():
                self.history.append((self.step, float(self._task.validate())))
        finally:
            module.load_state_dict(own)

    def as_data(self) -> dict[str, Any]:
        """Return the state as tensors in dicts and lists, and plain data."""
        return {
            "module": self._task.module.state_dict(),
            "average": self.average,
            "optimiser": self._optimiser.state_dict(),
            "step": self.step,
            "skipped": self.skipped,
            "failures": self.failures,
            "history": self.history,
            "extra": self._task.extra_state() if isinstance(self._task, RememberingTask) else {},
        }

    def load_data(self, data: dict[str, Any]) -> None:
        """Take over a state from `as_data`.

        Raises LookupError, RuntimeError, TypeError or ValueError if it doesn't fit the task.
        """
        self._task.module.load_state_dict(data["module"])
        self._optimiser.load_state_dict(data["optimiser"])
        for name, value in self.average.items():
            value.copy_(data["average"][name])
        self.step, self.skipped = int(data["step"]), int(data["skipped"])
        self.failures = int(data["failures"])
        self.history = [(int(step), float(score)) for step, score in data["history"]]
        if isinstance(self._task, RememberingTask):
            self._task.load_extra_state(data["extra"])

    def _apply_gradients(self, loss: float) -> None:
        """Change the weights by the gradients, unless they or the loss fail."""
        longest = self._schedule.clip or math.inf
        norm = torch.nn.utils.clip_grad_norm_(self._parameters, longest, foreach=False)
        if not (math.isfinite(loss) and math.isfinite(norm.item())):
            self.skipped += 1
            self.failures += 1
            return
        self.failures = 0
        rate = self._schedule.rate(self.step)
        for group, factor in zip(self._optimiser.param_groups, self._factors, strict=True):
            group["lr"] = rate * factor
        self._optimiser.step()
        decay = self._schedule.decay(self.step + 1 - self.skipped)
        for name, value in self._task.module.state_dict().items():
            if value.is_floating_point():
                self.average[name].lerp_(value, 1 - decay)
            else:
                self.average[name].copy_(value)


def _copy_weights(module: torch.nn.Module) -> dict[str, torch.Tensor]:
    """Return a copy of a module's weights, by name."""
    return {name: value.detach().clone() for name, value in module.state_dict().items()}
