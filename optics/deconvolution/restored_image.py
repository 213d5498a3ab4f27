"""The result of a restoration: the picture with its residual, weight and convergence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import torch


@dataclass(frozen=True, eq=False)
class RestoredImage:
    """A restored picture, with the data by which its quality can be judged.

    Parameters
    ----------
    image : torch.Tensor, (rows, columns)
        Light per pixel of the scene in the photograph's frame. Only linear filters make it
        negative.
    method : str
        Name of the method, in words.
    noise : float
        Standard deviation of a pixel of the photograph, as given or estimated.
    residual_source : float or callable
        The residual, or a function without arguments that computes it on first use: see `residual`.
    weight : float, optional
        Regularisation weight of the prior; None for methods without one.
    iterations : int, default 1
        Number of iterations done.
    relative_changes : list of float, optional
        Relative change of the picture in each iteration.
    converged : bool, default True
        Whether the last change fell below the tolerance asked for.
    period_image : torch.Tensor, optional
        The restored scene on the whole period, which includes the surroundings whose light reaches
        the frame. A later restoration can start from it.
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
        """The deconvolution's rms residual, relative to the noise.

        The residual is the photograph less the blurred restoration. It is about 1 if model, PSF and
        noise are right. Above 1.2, one of them is wrong.
        """
        if not callable(self.residual_source):
            return self.residual_source
        residual = self.residual_source()
        # This releases the function, which may hold large arrays.
        object.__setattr__(self, "residual_source", residual)
        return residual


@torch.no_grad()
def relative_change(now: torch.Tensor, before: torch.Tensor) -> float:
    """Return the relative L2 change between the pictures of two iterations of a deconvolution.

    The change is measured on every fourth row.
    """
    rows, old = now[::4], before[::4]
    scale = float(torch.linalg.vector_norm(rows))
    return float(torch.linalg.vector_norm(rows - old)) / scale if scale else 0.0
