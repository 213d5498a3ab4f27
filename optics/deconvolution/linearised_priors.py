"""The priors of a restoration, linearised at its solution, for derivatives by what it depends on.

How the solution follows a small change is again a restoration by splitting: the data term is the
same, the penalty is quadratic, and what is flat or held by bounds stays so.
"""

from __future__ import annotations

import torch

from optics.deconvolution.priors import RELAXATION, Box, DerivativePenalty, Prior, sum_products


class LinearTerm(Prior):
    """A term -<slope, x> of the objective of a deconvolution by splitting; it has no split."""

    def __init__(self, slope: torch.Tensor) -> None:
        self.gram_spectrum = torch.zeros(()).to(slope)
        self._slope = slope

    def coupling(self, weight: float, data: float) -> float:
        return 1.0

    def update(self, x: torch.Tensor, weight: float) -> None:
        self.adjoint_target = self._slope


class LinearisedPenalty(Prior):
    """The second derivative of a deconvolution's penalty at its solution, as a quadratic penalty.

    The joint length of derivatives, for a power of 1, is |W z|, with the weights W of the
    components. Its second derivative is (W² - g g^T) / |W z|, with g = W² z / |W z|. The split's
    step solves a linear system with this matrix, a diagonal less an outer product, by the
    Sherman-Morrison formula.
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
    """The bounds of a deconvolution at its solution: what they hold doesn't move."""

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
