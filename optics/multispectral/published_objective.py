"""The published objective of a spectral restoration, with its gradient (thesis Eq. 4.3-4.6)."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.inverse.bounded import Misfit, ValueAndGradient, differences, differences_adjoint


@dataclass(frozen=True, eq=False)
class PublishedObjective:
    """The objective of the thesis for the spectral bands of a scene (Eq. 4.3, 4.4 and 4.6).

    It is ``|A x - y|² + sum_n (α |∇x_n|² + β |∇x_n|₁) + sum_{n≠i} σ |∇x_n x_i - ∇x_i x_n|₁``, where
    a gradient has two components, the differences to the next row and to the next column, and
    ``|t|₁`` sums √(t² + ε²) - ε over components and pixels. Each pair of bands counts twice, since
    the sum over n ≠ i is over ordered pairs.

    Parameters
    ----------
    misfit : Misfit
        Half the data term.
    smoothness : float
        α, the weight of the squared gradients (Sobolev).
    variation : float
        β, the weight of the absolute gradients (total variation), in the light's unit.
    cross_channel : float
        σ, the weight of differences between two bands' hues.
    smoothing : float
        ε, the size below which an absolute value is rounded; in the light's unit for gradients,
        and in its square for hues.
    periodic : bool
        Whether opposite edges of the scene are neighbours.
    """

    misfit: Misfit
    smoothness: float
    variation: float
    cross_channel: float
    smoothing: float
    periodic: bool

    def __call__(self, x: torch.Tensor) -> ValueAndGradient:
        half, slope = self.misfit(x)
        value, gradient = 2 * half, 2 * slope
        for term, weight in (
            (self._within_bands, max(self.smoothness, self.variation)),
            (self._between_bands, self.cross_channel),
        ):
            if weight > 0:
                more, steeper = term(x)
                value, gradient = value + more, gradient.add_(steeper)
        return value, gradient

    def _within_bands(self, x: torch.Tensor) -> ValueAndGradient:
        """Compute the prior on each spectral band by itself, and its gradient (Eq. 4.4)."""
        value = x.new_zeros((), dtype=torch.float64)
        pulls = []
        for steps in differences(x, self.periodic):
            lengths = steps.square().add_(self.smoothing**2).sqrt_()
            value += self.smoothness * steps.square().sum(dtype=torch.float64)
            value += self.variation * _excess(lengths, self.smoothing)
            pulls.append(steps.mul(2 * self.smoothness).add_(self.variation * steps / lengths))
        return value, differences_adjoint(*pulls)

    def _between_bands(self, x: torch.Tensor) -> ValueAndGradient:
        """Compute the prior on each pair of spectral bands, and its gradient (Eq. 4.6)."""
        value = x.new_zeros((), dtype=torch.float64)
        gradient = torch.zeros_like(x)
        for dim in (-2, -1):
            next_x = self._neighbours(x, dim)
            own, others = torch.zeros_like(x), torch.zeros_like(x)
            for n in range(len(x) - 1):
                value += self._pairs_with(n, x, next_x, own, others)
            gradient.add_(own).add_(others.roll(1, dim))
        return 2 * self.cross_channel * value, gradient.mul_(2 * self.cross_channel)

    def _pairs_with(
        self,
        n: int,
        x: torch.Tensor,
        next_x: torch.Tensor,
        own: torch.Tensor,
        others: torch.Tensor,
    ) -> torch.Tensor:
        """Compute the prior on band n and all later bands, and add its gradient.

        With the neighbours x' of the pixels x, ∇x_n x_i - ∇x_i x_n is x'_n x_i - x'_i x_n. The
        gradient by x is added to `own`, and that by x' to `others`.
        """
        later, next_later = x[n + 1 :], next_x[n + 1 :]
        hue = torch.addcmul(later * next_x[n], next_later, x[n], value=-1)
        lengths = hue.square().add_(self.smoothing**2).sqrt_()
        value = _excess(lengths, self.smoothing)
        pull = hue.div_(lengths)
        own[n + 1 :].addcmul_(pull, next_x[n])
        others[n + 1 :].addcmul_(pull, x[n], value=-1)
        own[n].sub_((pull * next_later).sum(0))
        others[n].add_((pull * later).sum(0))
        return value

    def _neighbours(self, x: torch.Tensor, dim: int) -> torch.Tensor:
        """Return the next pixel of each pixel of the bands; itself where there is none."""
        moved = x.roll(-1, dim)
        if not self.periodic:
            last = x.shape[dim] - 1
            moved.narrow(dim, last, 1).copy_(x.narrow(dim, last, 1))
        return moved


def _excess(lengths: torch.Tensor, smoothing: float) -> torch.Tensor:
    """Sum the rounded absolute values √(t² + ε²) of a spectral prior, less ε each."""
    return lengths.sum(dtype=torch.float64) - smoothing * lengths.numel()
