"""The prior of demosaicing: brightness has little curvature, and colour differences have less."""

from __future__ import annotations

import math

import torch

from optics.deconvolution.priors import laplacian_spectrum


def helmert_matrix(bands: int) -> torch.Tensor:
    """Compute Helmert's orthonormal matrix of colour axes for demosaicing, (bands, bands).

    The first row is the mean of all bands, which is the brightness. Row k is the difference
    between band k and the mean of the bands before it.
    """
    rows = [torch.full((bands,), 1 / math.sqrt(bands), dtype=torch.float64)]
    for k in range(1, bands):
        row = torch.zeros(bands, dtype=torch.float64)
        row[:k], row[k] = 1.0, -float(k)
        rows.append(row / math.sqrt(k * (k + 1)))
    return torch.stack(rows)


class CurvaturePrior:
    """Penalises the curvature of a colour picture's brightness and of its colour differences.

    The penalty is |w ∇²L| + |∇²C|, summed over the pixels: the length of the second derivatives of
    the brightness L, and the joint length of those of all colour differences C. This is
    second-order total variation (Lefkimmiatis, Bourquard and Unser 2012, doi
    10.1109/TIP.2011.2168232) of luminance and of chrominance separately (Condat and Mosaddegh
    2012, doi 10.1109/ICIP.2012.6467476). The class holds the split of this penalty in the
    alternating direction method of multipliers (ADMM).

    `brightness` is w, and `threshold` is the length of the second derivatives, in the unit of the
    light, below which one iteration sets them to zero.
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
        """Update the demosaicing prior's split; return D^T (d - b) for the next picture.

        `colours` is the current picture on the colour axes, (bands, rows, columns); so is the
        result. d is the split of D x, and b is its scaled dual variable.
        """
        weights = self.weights[:, None, None]
        wanted = _second_differences(colours * weights).add_(self._dual)
        squares = wanted.square().sum(0)
        lengths = torch.empty_like(squares)
        lengths[:1] = squares[:1]
        lengths[1:] = squares[1:].sum(0, keepdim=True)
        taken = lengths.sqrt_().reciprocal_().mul_(self._threshold).clamp_(max=1)
        # The new b is the part that the threshold removes, d is the rest, and the next line
        # computes d - b.
        self._dual = wanted * taken
        return _second_differences_adjoint(wanted.sub_(self._dual, alpha=2)).mul_(weights)


def _second_differences(x: torch.Tensor) -> torch.Tensor:
    """Compute second differences of a periodic colour picture, for the demosaicing prior.

    Returns the differences down the columns, those along the rows, and the mixed ones times √2.
    """
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
    """Apply the adjoint of the demosaicing prior's second differences.

    `d` is (3, bands, rows, columns), as _second_differences() returns it.
    """
    across = d[2] * math.sqrt(2)
    down = (d[0] - d[0].roll(-1, -2)).add_(across.roll(1, -1)).sub_(across)
    along = d[1] - d[1].roll(-1, -1)
    return (down.roll(1, -2) - down).add_(along.roll(1, -1)).sub_(along)
