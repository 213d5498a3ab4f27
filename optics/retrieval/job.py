"""What every way from a target to frames gets."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch

from optics.progress import Progress
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import Superpixels, coarsest_superpixels


@dataclass(frozen=True)
class RetrievalJob:
    """One retrieval, made ready. start: one of STARTS."""

    goal: RetrievalGoal
    frames: int
    iterations: int
    generator: torch.Generator
    progress: Progress
    start: str

    @property
    def superpixels(self) -> Superpixels:
        """The coarsest superpixels that the goal allows."""
        return coarsest_superpixels(self.goal)

    @property
    def frame_progress(self) -> list[Progress]:
        """The progress of every frame, where one is computed after the other."""
        ends = [n / self.frames for n in range(self.frames + 1)]
        return [self.progress.part(start, stop) for start, stop in pairwise(ends)]
