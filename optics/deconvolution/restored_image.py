"""What a restoration gives, and how far to trust it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import torch


@dataclass(frozen=True, eq=False)
class RestoredImage:
    """A restored picture, and how far to trust it.

    Parameters
    ----------
    image : torch.Tensor, (rows, columns)
        Light per pixel of the scene in the photograph's frame. Never negative but for linear
        filters.
    method : str
        Name of the method, in words.
    noise : float
        Standard deviation that a pixel of the photograph was taken to have.
    residual_source : float or callable
        The residual, or a function without arguments that computes it on first use: see `residual`.
    weight : float, optional
        Regularisation weight of the prior against the data; None for methods without one.
    iterations : int, default 1
        Number of iterations done.
    relative_changes : list of float, optional
        Relative change of the picture in each iteration.
    converged : bool, default True
        Whether the last change fell below the tolerance asked for.
    period_image : torch.Tensor, optional
        The scene around the frame as well, as far as its light comes into the frame. A later
        restoration can start from it.
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
        """Rms of the photograph less the blurred restoration, over the noise.

        About 1 where model, PSF and noise are right; above 1.2 one of them isn't.
        """
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
