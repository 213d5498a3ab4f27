"""What a task offers to the loop that trains it, and where its random numbers are from.

A task is what is trained, on what: the denoiser on photographs, or a pattern with its decoder on
scenes. `labapp.training.loop` trains every task in the same way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch

VALIDATION_STEP = 2**32 - 1
"""The step of `sample_generator` for validation. Chosen: no training takes so many steps, so that
no step has the same random numbers."""


class TrainingTask(Protocol):
    """What is trained, on what.

    A task whose losses depend on more than weights and random numbers, for instance on what earlier
    steps computed, is a `RememberingTask` too.
    """

    @property
    def settings(self) -> Mapping[str, Any]:
        """Everything that the result depends on besides the schedule, as plain data.

        An interrupted training goes on only with the same settings. Name data by their content, for
        instance by a checksum of the pictures.
        """

    @property
    def module(self) -> torch.nn.Module:
        """All that is trained, on the device where it is trained, in float32 or float64."""

    @property
    def samples(self) -> int:
        """Samples of one step, over all processes."""

    def parameter_groups(self) -> list[dict[str, Any]]:
        """Return the groups of parameters with their learning rates.

        "params" is a list of parameters, "rate" the factor of the schedule's learning rate; further
        entries, such as "betas", go to torch.optim.Adam.
        """

    def losses(self, step: int, samples: Sequence[int]) -> torch.Tensor:
        """Return the losses of samples of a step, (len(samples),).

        The step lowers the mean over all samples of all processes. The random numbers of each
        sample come from `sample_generator` alone, so that the result depends neither on the number
        of processes nor on interruptions.
        step: number of the step, from 0.
        samples: numbers of the samples that this process computes, from 0 to below `self.samples`.
        """

    def validate(self) -> float:
        """Rate the weights that `module` holds now, and return a score, higher for better.

        Every process calls this at the same time, without gradients. It changes nothing.
        """


@runtime_checkable
class RememberingTask(Protocol):
    """A task that keeps more than its module from step to step.

    What it keeps must be the same in all processes (`Processes.gather` makes it so), and finite
    even where a loss isn't: a step that is skipped leaves it as it is.
    """

    def extra_state(self) -> dict[str, Any]:
        """Return what the task keeps: tensors in dicts and lists, and plain data."""

    def load_extra_state(self, state: dict[str, Any]) -> None:
        """Take over what `extra_state` returned; its tensors are on the CPU."""


def sample_generator(seed: int, step: int, sample: int) -> np.random.Generator:
    """Return the source of all random numbers of one sample of a step.

    It is a new generator, always in the same state for the same numbers.
    seed: not negative.
    step: number of the step, or `VALIDATION_STEP`.
    sample: number of the sample in the step.
    """
    return np.random.default_rng((seed, step, sample))
