"""How much noise a mosaic has: read off where the scene is smoothest."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from scipy.stats import chi2

_BLOCK = 16
"""Samples of one filter along each side of a block that is looked at."""

_SMOOTHEST = 0.02
"""Quantile of the blocks that is taken for smooth."""

_SECOND_DIFFERENCE = (1.0, -2.0, 1.0)

_SAMPLES_PER_INDEPENDENT = 1 + 2 * ((4 / 6) ** 2 + (1 / 6) ** 2)
"""Neighbouring answers of _BEND to white noise are alike: of so many, along an axis, one counts."""


def estimate_mosaic_noise(raw: torch.Tensor, period: Sequence[int]) -> float:
    """Standard deviation of a pixel of a mosaic, (rows, columns), whose pattern repeats by
    (rows, columns).

    Of what second differences both ways leave of the samples of one filter (Immerkaer 1996, doi
    10.1006/cviu.1996.0060), in blocks: the smoothest few, as white noise would have them. The
    scene's finest detail counts as noise where nothing is smooth; 0 for frames of less than three
    samples a filter.
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
    count = (_BLOCK / _SAMPLES_PER_INDEPENDENT) ** 2
    expected = float(chi2.ppf(_SMOOTHEST, count)) / count if len(found) > 1 / _SMOOTHEST else 1.0
    return math.sqrt(smooth / expected)


def _block_variances(plane: torch.Tensor) -> list[torch.Tensor]:
    """Mean squares of what is no straight line, over that of white noise of unit variance."""
    if min(plane.shape) < 3:
        return []
    bend = torch.tensor(_SECOND_DIFFERENCE, dtype=torch.float64)
    kernel = bend[:, None] * bend
    left = torch.nn.functional.conv2d(plane.to(torch.float64)[None, None], kernel[None, None])
    squares = left[0, 0].square() / float(kernel.square().sum())
    block = min(_BLOCK, *squares.shape)
    rows, columns = (n // block * block for n in squares.shape)
    parts = squares[:rows, :columns].reshape(rows // block, block, columns // block, block)
    return list(parts.mean((1, 3)).flatten())
