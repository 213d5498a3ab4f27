"""What is known of colour pictures: brightness bends at edges, colours hardly anywhere."""

from __future__ import annotations

import math

import torch

from optics.deconvolution.priors import laplacian_spectrum


def helmert_matrix(bands: int) -> torch.Tensor:
    """Orthonormal directions of colour, (bands, bands): the mean of all, then differences that
    are wider each (Helmert's matrix)."""
    rows = [torch.full((bands,), 1 / math.sqrt(bands), dtype=torch.float64)]
    for k in range(1, bands):
        row = torch.zeros(bands, dtype=torch.float64)
        row[:k], row[k] = 1.0, -float(k)
        rows.append(row / math.sqrt(k * (k + 1)))
    return torch.stack(rows)


class CurvaturePrior:
    """The curvature of a picture's brightness, and of all its colour differences in one, as lengths
    of their second derivatives: |w ∇²L| + |∇²C|, summed over the pixels.

    Second-order total variation (Lefkimmiatis, Bourquard and Unser 2012, doi
    10.1109/TIP.2011.2168232) of luminance and chrominance apart (Condat and Mosaddegh 2012, doi
    10.1109/ICIP.2012.6467476). A split of its own for the alternating direction method.

    brightness: w. threshold: curvature that a first step takes for none.
    """

    def __init__(
        self, bands: int, shape: tuple[int, int], brightness: float, threshold: float,
        dtype: torch.dtype,
    ) -> None:  # fmt: skip
        self.colour_axes = helmert_matrix(bands).to(dtype)
        self.weights = torch.ones(bands, dtype=dtype)
        self.weights[0] = brightness
        self.gram_spectrum = laplacian_spectrum(shape).square().to(dtype)
        self._threshold = threshold
        self._dual = torch.zeros((3, bands, *shape), dtype=dtype)

    def update(self, colours: torch.Tensor) -> torch.Tensor:
        """D^T (d - b) of the next picture's split, of colours, (bands, rows, columns)."""
        weights = self.weights[:, None, None]
        wanted = _second_differences(colours * weights).add_(self._dual)
        squares = wanted.square().sum(0)
        lengths = torch.empty_like(squares)
        lengths[:1] = squares[:1]
        lengths[1:] = squares[1:].sum(0, keepdim=True)
        taken = lengths.sqrt_().reciprocal_().mul_(self._threshold).clamp_(max=1)
        # b is what the threshold has taken, and d - b the rest less that.
        self._dual = wanted * taken
        return _second_differences_adjoint(wanted.sub_(self._dual, alpha=2)).mul_(weights)


def _second_differences(x: torch.Tensor) -> torch.Tensor:
    """Second derivatives by differences around the period: down, along, and across times √2."""
    down = x.roll(-1, -2).sub_(x)
    along = x.roll(-1, -1).sub_(x)
    return torch.stack(
        [
            down - down.roll(1, -2),
            along - along.roll(1, -1),
            down.roll(-1, -1).sub_(down).mul_(math.sqrt(2)),
        ]
    )


def _second_differences_adjoint(d: torch.Tensor) -> torch.Tensor:
    across = d[2] * math.sqrt(2)
    down = (d[0] - d[0].roll(-1, -2)).add_(across.roll(1, -1)).sub_(across)
    along = d[1] - d[1].roll(-1, -1)
    return (down.roll(1, -2) - down).add_(along.roll(1, -1)).sub_(along)
