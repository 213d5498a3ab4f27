"""Estimation of the noise of a mosaic of colour filters from its smoothest blocks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from scipy.stats import chi2

_BLOCK = 16
"""Side of a block of the mosaic, in samples of one filter."""

_SMOOTHEST = 0.02
"""Quantile of the blocks' variances that is taken as the variance of smooth blocks."""


def estimate_mosaic_noise(raw: torch.Tensor, period: Sequence[int]) -> float:
    """Estimate the standard deviation of a pixel of a raw mosaic of colour filters.

    `raw` is (rows, columns), and its filter pattern repeats after `period` (rows, columns). The
    samples of each filter are filtered by second differences along both axes (Immerkaer 1996, doi
    10.1006/cviu.1996.0060). The variances of blocks are sorted; the noise is the one for which
    white noise would give the variance that is found at a low quantile. Where no part of the scene
    is smooth, its finest detail counts as noise. The result is 0 if a filter has fewer than three
    samples along an axis.
    """
    found = [
        value
        for row in range(int(period[0]))
        for column in range(int(period[1]))
        for value in _block_variances(raw[row :: int(period[0]), column :: int(period[1])])
    ]
    if not found:
        return 0.0
    smooth = float(torch.quantile(torch.stack(found), _SMOOTHEST))
    # Neighbouring second differences of white noise are correlated. Along an axis, this number of
    # them counts as one independent sample: the sum of the squared correlation coefficients.
    samples_per_independent = 1 + 2 * ((4 / 6) ** 2 + (1 / 6) ** 2)
    count = (_BLOCK / samples_per_independent) ** 2
    expected = float(chi2.ppf(_SMOOTHEST, count)) / count if len(found) > 1 / _SMOOTHEST else 1.0
    return math.sqrt(smooth / expected)


def _block_variances(plane: torch.Tensor) -> list[torch.Tensor]:
    """Estimate the noise variance of blocks of one mosaic filter's samples by second differences.

    White noise of unit variance gives 1.
    """
    if min(plane.shape) < 3:
        return []
    bend = torch.tensor((1.0, -2.0, 1.0), dtype=torch.float64)
    kernel = bend[:, None] * bend
    left = torch.nn.functional.conv2d(plane.to(torch.float64)[None, None], kernel[None, None])
    squares = left[0, 0].square() / float(kernel.square().sum())
    block = min(_BLOCK, *squares.shape)
    rows, columns = (n // block * block for n in squares.shape)
    parts = squares[:rows, :columns].reshape(rows // block, block, columns // block, block)
    return list(parts.mean((1, 3)).flatten())
