"""What every way from a target to frames gets."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch

from optics.progress import Progress
from optics.retrieval.goal import Goal
from optics.retrieval.superpixel import Superpixels, coarsest


@dataclass(frozen=True)
class Job:
    """One retrieval, made ready. start: one of STARTS."""

    goal: Goal
    frames: int
    iterations: int
    generator: torch.Generator
    progress: Progress
    start: str

    @property
    def pixels(self) -> Superpixels:
        """The coarsest superpixels that the goal allows."""
        return coarsest(self.goal)

    @property
    def parts(self) -> list[Progress]:
        """The progress of every frame, where one is computed after the other."""
        ends = [n / self.frames for n in range(self.frames + 1)]
        return [self.progress.part(start, stop) for start, stop in pairwise(ends)]
