"""Priors of pictures, each of which is one split of the problem.

They penalise derivatives of periodic pictures. Linearised at the solution, they give the derivative
by what it depends on.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch

from optics.inverse.band_coupling import BandCoupling


def laplacian_spectrum(shape: tuple[int, int]) -> torch.Tensor:
    """Return the spectrum of the negative Laplacian, the gradient's adjoint times the gradient.

    It is on the rfft2 grid of a period, (rows, columns // 2 + 1), in double precision.
    """
    y = 2 - 2 * torch.cos(2 * math.pi * torch.fft.fftfreq(shape[0], dtype=torch.float64))
    x = 2 - 2 * torch.cos(2 * math.pi * torch.fft.rfftfreq(shape[1], dtype=torch.float64))
    return y[:, None] + x[None, :]


def add_gradient(x: torch.Tensor, parts: Sequence[torch.Tensor], factor: float = 1.0) -> None:
    """Add the forward differences down columns and along rows, times a factor, to `parts`."""
    (down, along), plus, minus = parts, {"alpha": factor}, {"alpha": -factor}
    down[..., :-1, :].add_(x[..., 1:, :], **plus).add_(x[..., :-1, :], **minus)
    down[..., -1, :].add_(x[..., 0, :], **plus).add_(x[..., -1, :], **minus)
    along[..., :-1].add_(x[..., 1:], **plus).add_(x[..., :-1], **minus)
    along[..., -1].add_(x[..., 0], **plus).add_(x[..., -1], **minus)


def gradient_adjoint(parts: Sequence[torch.Tensor], out: torch.Tensor) -> torch.Tensor:
    """Apply the adjoint of the periodic gradient, and write the result to `out`."""
    down, along = parts
    torch.add(down, along, out=out).neg_()
    out[..., 1:, :].add_(down[..., :-1, :])
    out[..., 0, :].add_(down[..., -1, :])
    out[..., 1:].add_(along[..., :-1])
    out[..., 0].add_(along[..., -1])
    return out


def gradient_of(x: torch.Tensor, factor: float = 1.0) -> tuple[torch.Tensor, torch.Tensor]:
    """Return a periodic picture's forward differences, times a factor: see add_gradient()."""
    parts = torch.zeros_like(x), torch.zeros_like(x)
    add_gradient(x, parts, factor)
    return parts


def _add_curvature(x: torch.Tensor, parts: Sequence[torch.Tensor], factor: float = 1.0) -> None:
    """Add second differences down the columns, along the rows, and across both, times √2.

    Together they don't depend on the direction.
    """
    down, along = gradient_of(x, factor)
    twice_down, twice_along, across = parts
    twice_down.add_(down)
    twice_down[..., 1:, :].sub_(down[..., :-1, :])
    twice_down[..., 0, :].sub_(down[..., -1, :])
    twice_along.add_(along)
    twice_along[..., 1:].sub_(along[..., :-1])
    twice_along[..., 0].sub_(along[..., -1])
    across[..., :-1].add_(down[..., 1:], alpha=math.sqrt(2))
    across[..., -1].add_(down[..., 0], alpha=math.sqrt(2))
    across.sub_(down, alpha=math.sqrt(2))


def _curvature_adjoint(parts: Sequence[torch.Tensor], out: torch.Tensor) -> torch.Tensor:
    twice_down, twice_along, across = parts
    down, along = twice_down.clone(), twice_along.clone()
    down[..., :-1, :].sub_(twice_down[..., 1:, :])
    down[..., -1, :].sub_(twice_down[..., 0, :])
    down[..., 1:].add_(across[..., :-1], alpha=math.sqrt(2))
    down[..., 0].add_(across[..., -1], alpha=math.sqrt(2))
    down.sub_(across, alpha=math.sqrt(2))
    along[..., :-1].sub_(twice_along[..., 1:])
    along[..., -1].sub_(twice_along[..., 0])
    return gradient_adjoint((down, along), out)


class Derivative(NamedTuple):
    """A derivative of periodic pictures, (..., rows, columns), which consists of so many `parts`.

    gram_spectrum: adjoint times derivative on the rfft2 grid of a period, float64.
    add: adds a picture's derivative, times a factor, to parts in place.
    adjoint: applies the adjoint to parts, and writes the result to another picture.
    """

    parts: int
    gram_spectrum: Callable[[tuple[int, int]], torch.Tensor]
    add: Callable[..., None]
    adjoint: Callable[[Sequence[torch.Tensor], torch.Tensor], torch.Tensor]


GRADIENT = Derivative(2, laplacian_spectrum, add_gradient, gradient_adjoint)
CURVATURE = Derivative(
    3, lambda shape: laplacian_spectrum(shape).square(), _add_curvature, _curvature_adjoint
)


LEAST_WEIGHT_SHARE = 0.7
"""Least weight by the evidence over the first one, which the photograph's spectrum predicts."""


def weight_by_evidence(penalty: float, power: float, noise: float, explained_share: float) -> float:
    """Estimate a prior's weight from the evidence of a picture.

    For a penalty that grows with a power of the picture, the evidence (MacKay 1992, doi
    10.1162/neco.1992.4.3.415) gives power * weight * penalty = freedom * noise².

    penalty: mean penalty of a pixel.
    explained_share: share of the data that the picture explains.
    """
    # 0.9 of the weight by the evidence restores best: measured for 72 photographs, between 0.78
    # and 1.1, where it hardly matters. Of the two components of the gradient, the one along an
    # edge is nearly free, so that not all of the gradient's freedom counts.
    return 0.9 * explained_share * noise**2 / max(power * penalty, 1e-30)


RELAXATION = 1.8
"""Over-relaxation of the splits: 1 is none, below 2 converges (Eckstein and Bertsekas 1992, doi
10.1007/BF01581204). It saves about a third of the iterations."""


class Prior(ABC):
    """Base class of priors on D x, where D x of pictures (bands, rows, columns) is split off.

    gram_spectrum: D^T D on the frequencies of a period, (rows, columns // 2 + 1), or one number.
    adjoint_target: D^T (d - b), the split's part in the right-hand side of the next picture's step
        for a coupling of 1; d is the split and b its scaled dual variable. None before the first
        step. Each step may overwrite the array.
    component_scales: factors of the components before they are split, (bands,), whose squares
        multiply D^T D. All are 1 if None.
    """

    gram_spectrum: torch.Tensor
    adjoint_target: torch.Tensor | None = None
    component_scales: torch.Tensor | None = None

    @abstractmethod
    def update(self, x: torch.Tensor, weight: float) -> None:
        """Update split and dual variable for the next picture `x`."""

    @abstractmethod
    def coupling(self, weight: float, data: float) -> float:
        """Return the split's coupling, for a weight and the data's coupling."""


class DerivativePenalty(Prior):
    """The joint length of derivatives to a power, as a penalty.

    With gradients and a power of 1 it is total variation (Rudin, Osher and Fatemi 1992, doi
    10.1016/0167-2789(92)90242-F), and with curvatures second-order total variation (Lefkimmiatis,
    Bourquard and Unser 2012, doi 10.1109/TIP.2011.2168232). A lower power suits the heavier tails
    of natural pictures (Krishnan and Fergus 2009). The penalty doesn't depend on the direction.

    bands: how the bands of pictures of `shape` are coupled.
    threshold: length, in light per pixel, below which a first iteration sets derivatives to 0.
    weight_factor: multiplies the weight by the evidence.
    """

    def __init__(
        self,
        bands: BandCoupling,
        shape: tuple[int, int],
        threshold: float,
        dtype: torch.dtype,
        *,
        power: float = 1.0,
        derivative: Derivative = GRADIENT,
        relaxation: float = RELAXATION,
        weight_factor: float = 1.0,
    ) -> None:
        self.bands, self.threshold, self._power = bands, threshold, power
        self._weight_factor = weight_factor
        self.derivative, self._relaxation = derivative, relaxation
        self.gram_spectrum = derivative.gram_spectrum(shape).to(dtype)
        self.component_scales = bands.scales
        whole = (bands.bands, *shape)
        self._parts = list(torch.zeros(derivative.parts, *whole, dtype=dtype))
        self._out, self._one = torch.empty(whole, dtype=dtype), torch.ones((), dtype=dtype)

    def coupling(self, weight: float, data: float) -> float:
        return self._power * weight / self.threshold ** (2 - self._power)

    def estimate_weight(self, x: torch.Tensor, noise: float, explained_share: float) -> float:
        mean = mean_gradient(x, self._power, self.bands)
        estimate = weight_by_evidence(mean, self._power, noise, explained_share)
        return self._weight_factor * estimate

    def update(self, x: torch.Tensor, weight: float) -> None:
        self.derivative.add(self.bands.components(x), self._parts, self._relaxation)
        removed = self._removed_share(self._parts)
        # The new b is the removed part, and d - b is the derivative less twice that part. What is
        # kept of both is b and, for the over-relaxation, a share of d.
        kept = torch.add(self._one, removed, alpha=-2)
        wanted = [part * kept for part in self._parts]
        torch.add(self._one * (1 - self._relaxation), removed, alpha=self._relaxation, out=removed)
        for part in self._parts:
            part.mul_(removed)
        target = self.derivative.adjoint(wanted, self._out)
        self.adjoint_target = self.bands.components_adjoint(target)

    def derivative_of(self, x: torch.Tensor) -> list[torch.Tensor]:
        """Return the derivative of a picture's components, in its parts."""
        parts = [torch.zeros_like(part) for part in self._parts]
        self.derivative.add(self.bands.components(x), parts)
        return parts

    def is_flat(self, x: torch.Tensor) -> torch.Tensor:
        """Return where the next step's split at the solution x is 0, broadcast to components."""
        parts = [part.clone() for part in self._parts]
        self.derivative.add(self.bands.components(x), parts, self._relaxation)
        return self._removed_share(parts) >= 1

    def _removed_share(self, parts: Sequence[torch.Tensor]) -> torch.Tensor:
        return self.bands.removed_share(sum_products(parts, parts), self.threshold, self._power)


def sum_products(parts: Sequence[torch.Tensor], others: Sequence[torch.Tensor]) -> torch.Tensor:
    """Return the inner product of two derivatives at each pixel."""
    total = parts[0] * others[0]
    for a, b in zip(parts[1:], others[1:], strict=True):
        total.addcmul_(a, b)
    return total


# Coupling of the split of Box, relative to that of the data. Measured with four PSFs, two noises,
# 12 and 30 iterations: 0.3 is up to 2.3 dB better than 1.
_BOX_COUPLING = 0.3


class Box(Prior):
    """The prior that light is within bounds, and is 0 outside a known support."""

    def __init__(self, support: torch.Tensor | None = None, upper: float = math.inf) -> None:
        self.gram_spectrum = torch.ones(())
        self._support, self._upper = support, upper
        self._kept: torch.Tensor | None = None

    def coupling(self, weight: float, data: float) -> float:
        return data * _BOX_COUPLING

    def _unlimited_split(self, x: torch.Tensor) -> torch.Tensor:
        """Return what the next step limits: picture and dual variable."""
        return x * RELAXATION if self._kept is None else self._kept.add(x, alpha=RELAXATION)

    def is_held(self, x: torch.Tensor) -> torch.Tensor:
        """Return 1 where the bounds hold the light at the solution x, else 0."""
        moved = self._unlimited_split(x)
        held = (moved <= 0) | (moved >= self._upper)
        return (held if self._support is None else held | (self._support == 0)).to(x)

    def update(self, x: torch.Tensor, weight: float) -> None:
        moved = self._unlimited_split(x)
        allowed = moved.clamp(min=0, max=self._upper)
        if self._support is not None:
            allowed.mul_(self._support)
        dual = moved.sub_(allowed)
        self._kept = torch.add(dual, allowed, alpha=1 - RELAXATION)
        self.adjoint_target = allowed.sub_(dual)


def mean_gradient(x: torch.Tensor, power: float, bands: BandCoupling | None = None) -> float:
    """Compute the mean length of a picture's gradients to a power, in every n-th row of large ones.

    With several bands, it is the mean over the pixels of the penalty of all groups of components.
    """
    every = max(1, x.shape[-2] * x.shape[-1] >> 18)
    # A picture of one row or column has no gradient across it.
    x = x.repeat(*(1,) * (x.ndim - 2), 1 + (x.shape[-2] == 1), 1 + (x.shape[-1] == 1))
    rows = x[..., :-1:every, :]
    down, along = (x[..., 1::every, :] - rows)[..., :-1], rows[..., 1:] - rows[..., :-1]
    if bands is not None and bands.axes is not None:
        down, along = bands.components(down), bands.components(along)
    squares = torch.addcmul(along * along, down, down)
    length = squares.sqrt_() if bands is None else bands.lengths(squares)
    mean = float((length if power == 1 else length.pow_(power)).mean())
    return mean if bands is None else mean * len(bands.groups)


class LinearTerm(Prior):
    """A term -<slope, x> of the objective, which has no split."""

    def __init__(self, slope: torch.Tensor) -> None:
        self.gram_spectrum = torch.zeros(()).to(slope)
        self._slope = slope

    def coupling(self, weight: float, data: float) -> float:
        return 1.0

    def update(self, x: torch.Tensor, weight: float) -> None:
        self.adjoint_target = self._slope


class LinearisedPenalty(Prior):
    """The second derivative of a penalty at the solution, as a quadratic penalty.

    The joint length of derivatives, for a power of 1, is |W z|, with the weights W of the
    components. Its second derivative is (W² - g g^T) / |W z|, with g = W² z / |W z|. The split's
    step solves a system with this matrix by the Sherman-Morrison formula.
    """

    def __init__(self, penalty: DerivativePenalty, solution: torch.Tensor) -> None:
        self._penalty, bands = penalty, penalty.bands
        self.gram_spectrum = penalty.gram_spectrum
        self.component_scales = penalty.component_scales
        own = penalty.derivative_of(solution)
        self._parts = [torch.zeros_like(part) for part in own]
        weights = bands.weights.to(solution)[:, None, None].square()
        length = bands.group_totals(weights * sum_products(own, own)).sqrt_().clamp_(min=1e-30)
        ratio = penalty.threshold / length
        slope = [weights * part / length for part in own]
        # 0 where the solution is flat, so that it stays flat.
        self._inverse = (
            (1 + ratio * weights).reciprocal_().masked_fill_(penalty.is_flat(solution), 0)
        )
        self._back = [self._inverse * part for part in slope]
        self._share = ratio / (1 - ratio * bands.group_totals(sum_products(slope, self._back)))

    def coupling(self, weight: float, data: float) -> float:
        return self._penalty.coupling(weight, data)

    def update(self, x: torch.Tensor, weight: float) -> None:
        bands, derivative = self._penalty.bands, self._penalty.derivative
        derivative.add(bands.components(x), self._parts, RELAXATION)
        along = bands.group_totals(sum_products(self._back, self._parts)) * self._share
        split = [
            self._inverse * part + back * along
            for part, back in zip(self._parts, self._back, strict=True)
        ]
        wanted = [2 * d - part for d, part in zip(split, self._parts, strict=True)]
        for d, part in zip(split, self._parts, strict=True):
            part.sub_(d, alpha=RELAXATION)
        self.adjoint_target = bands.components_adjoint(
            derivative.adjoint(wanted, torch.empty_like(x))
        )


class LinearisedBox(Prior):
    """The bounds at the solution: what they hold doesn't move."""

    def __init__(self, box: Box, solution: torch.Tensor) -> None:
        self.gram_spectrum = box.gram_spectrum
        self._box, self._free = box, 1 - box.is_held(solution)
        self._kept = torch.zeros_like(solution)

    def coupling(self, weight: float, data: float) -> float:
        return self._box.coupling(weight, data)

    def update(self, x: torch.Tensor, weight: float) -> None:
        moved = self._kept.add_(x, alpha=RELAXATION)
        split = moved * self._free
        self.adjoint_target = 2 * split - moved
        self._kept = moved.sub_(split, alpha=RELAXATION)
