"""Describe one phase retrieval as every retrieval method receives it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch

from optics.progress import Progress
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import Superpixels, coarsest_superpixels


@dataclass(frozen=True)
class RetrievalJob:
    """One phase retrieval with all that a method needs; `start` is one of STARTS."""

    goal: RetrievalGoal
    frames: int
    iterations: int
    generator: torch.Generator
    progress: Progress
    start: str

    @property
    def superpixels(self) -> Superpixels:
        """Return the coarsest superpixels that the phase retrieval's goal allows."""
        return coarsest_superpixels(self.goal)

    @property
    def frame_progress(self) -> list[Progress]:
        """Return one progress for each frame of a phase retrieval that computes them in turn."""
        ends = [n / self.frames for n in range(self.frames + 1)]
        return [self.progress.part(start, stop) for start, stop in pairwise(ends)]
