"""What a restoration gives, and how far to trust it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import torch


@dataclass(frozen=True, eq=False)
class RestoredImage:
    """A restored picture.

    image: (rows, columns), light per pixel of the scene in the photograph's frame; never negative
    but for linear filters. method: in words. noise: standard deviation that the photograph was
    taken to have. residual_source: the residual, or what works it out once somebody asks. weight:
    of what is known of pictures beforehand, against the data; None where there is none.
    relative_changes: of the picture in the last iteration, relative, after each. converged: whether
    it fell below what was asked. period_image: the scene around the frame as well, as far as light
    comes into it, for whoever goes on from there.
    """

    image: torch.Tensor
    method: str
    noise: float
    residual_source: float | Callable[[], float]
    weight: float | None = None
    iterations: int = 1
    relative_changes: list[float] = field(default_factory=list)
    converged: bool = True
    period_image: torch.Tensor | None = None

    @property
    def residual(self) -> float:
        """Rms of the photograph less the blurred restoration, over the noise: about 1 where model,
        PSF and noise are right; above 1.2 something isn't."""
        if not callable(self.residual_source):
            return self.residual_source
        residual = self.residual_source()
        # What it was worked out from may be large, and is needed no more.
        object.__setattr__(self, "residual_source", residual)
        return residual


@torch.no_grad()
def relative_change(now: torch.Tensor, before: torch.Tensor) -> float:
    """Of a picture, in every fourth row."""
    rows, old = now[::4], before[::4]
    scale = float(torch.linalg.vector_norm(rows))
    return float(torch.linalg.vector_norm(rows - old)) / scale if scale else 0.0
