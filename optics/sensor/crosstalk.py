"""Crosstalk of pixels: charge and light that neighbours collect in a pixel's place."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray


def mix_neighbours(electrons: torch.Tensor, share: float) -> torch.Tensor:
    """Return the electrons that pixels collect when each loses some to its neighbours.

    Along rows and along columns, the two neighbours of a pixel get `share` of its electrons each,
    0 to 1/4. Pixels beyond the sensor's edge are taken to be as bright as those at the edge, so
    that no light is lost there. Djité et al. 2012, Theoretical models of modulation transfer
    function, quantum efficiency, and crosstalk for CCD and CMOS image sensors.
    """
    for axis in (-2, -1):
        count = electrons.shape[axis]
        before = torch.arange(-1, count - 1).clamp(min=0)
        after = torch.arange(1, count + 1).clamp(max=count - 1)
        beside = electrons.index_select(axis, before) + electrons.index_select(axis, after)
        electrons = (1 - 2 * share) * electrons + share * beside
    return electrons


def max_contrast_loss(
    share: float, frequency: NDArray[np.float64], pitch: float
) -> NDArray[np.float64]:
    """Bound what crosstalk takes of the MTF, at cycles per metre in any direction.

    The MTF is the product of 1 - 2 share (1 - cos 2π f pitch) along both axes.
    """
    return np.minimum(share * (2 * np.pi * frequency * pitch) ** 2, 1 - (1 - 4 * share) ** 2)
