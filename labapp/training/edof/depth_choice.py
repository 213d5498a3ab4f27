"""Choose the depths of scenes, evenly or by how much the PSF changes with depth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.training.edof.config import EdofTrainingConfig


def depth_chances(transfers: torch.Tensor, config: EdofTrainingConfig) -> torch.Tensor:
    """Return the probability of each depth, (depths,), float64.

    With the importance "focus-shift" it is proportional to the change of the PSF from depth to
    depth. In metres that is thesis Eq. 5.10: the density of distances d is |dh/dd|, and a distance
    of d metres is 1/d dioptres, so that the density of dioptres D is |dh/dD|.
    transfers: at each depth, (depths, side, side // 2 + 1).
    """
    count = len(transfers)
    if config.depths.importance == "even" or config.depths.distances_m or count < 3:
        return torch.full((count,), 1 / count, dtype=torch.float64)
    steps = (transfers[1:] - transfers[:-1]).abs().square().sum((1, 2)).sqrt().double()
    # The change at a depth is the mean of that from the depth before and to the next.
    changes = torch.cat([steps[:1], (steps[1:] + steps[:-1]) / 2, steps[-1:]])
    return changes / changes.sum()


def depth_indices(
    chances: torch.Tensor, depths: NDArray[np.float64] | Sequence[float]
) -> list[int]:
    """Return which of the depths random numbers from 0 to below 1 choose.

    chances: probability of each depth, (depths,).
    """
    ends = _cumulative(chances)
    found = np.searchsorted(ends, np.asarray(depths), side="right")
    return [int(one) for one in np.minimum(found, len(ends) - 1)]


def choose_dioptres(
    chances: torch.Tensor, depths: Sequence[float], depth_range: tuple[float, float]
) -> list[float]:
    """Return the depths in dioptres that random numbers from 0 to below 1 choose.

    chances: probability of each of so many equal parts of the range of depths, farthest first;
    within a part all depths are equally likely.
    """
    ends = np.concatenate([[0.0], _cumulative(chances)])
    places = np.linspace(*depth_range, len(ends))
    return [float(one) for one in np.interp(depths, ends, places)]


def _cumulative(chances: torch.Tensor) -> NDArray[np.float64]:
    """Return the sums of probabilities up to each depth; the last one is 1."""
    ends = np.cumsum(chances.double().cpu().numpy())
    return np.asarray(ends / ends[-1])
