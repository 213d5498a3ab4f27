"""The share of the light that no pattern moves out of the centre."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_EXPECTED_SHARE_ERROR = 0.2
"""Of what gratings leave in the centre by themselves: how far the expected share may be off."""

_REACH = 6
"""Pixels around the centre that are looked at."""


@dataclass(frozen=True)
class ZerothOrder:
    """share: of the light that stays in the centre whatever the pattern. sigma: its standard
    deviation. by_frame: what each frame says."""

    share: float
    sigma: float
    by_frame: tuple[float, ...]


def measure_zeroth_order(
    neutral_picture: Array,
    steered_pictures: Sequence[Array],
    variance: Sequence[Array],
    expected: Sequence[float],
    centre: tuple[float, float],
    usable: NDArray[np.bool_],
) -> ZerothOrder:
    """What gratings leave in the centre, relative to a neutral pattern.

    neutral_picture: light less its dark, (rows, columns), where all light is in the centre.
    steered_pictures: of gratings that send it away, at the same exposure; variance: of each
    difference to what is expected. expected: share of the modulated light that each grating leaves
    in the centre by itself, as the calibrated response has it. centre: (y, x) pixel. usable: pixels
    neither clipped nor hot. All have the neutral star's shape in the centre, so that it is the
    weight. Raises ValueError if the neutral centre is dark, or no grating was shown.
    """
    if not steered_pictures or not len(steered_pictures) == len(variance) == len(expected):
        raise ValueError(
            f"{len(steered_pictures)} steered pictures, {len(variance)} variances and "
            f"{len(expected)} expected shares; give one of each for every grating"
        )
    part = tuple(slice(max(round(c) - _REACH, 0), round(c) + _REACH + 1) for c in centre)
    weight = np.where(usable[part], np.clip(neutral_picture[part], 0, None), 0.0)
    total = float((weight * neutral_picture[part]).sum())
    if not total > 0:
        raise ValueError("the neutral star's centre is dark or clipped; expose it otherwise")
    shares, noises = [], []
    for light, noise, left in zip(steered_pictures, variance, expected, strict=True):
        ratio = float((weight * light[part]).sum()) / total
        shares.append((ratio - left) / (1 - left))
        noises.append(math.sqrt(float((weight**2 * noise[part]).sum())) / total / (1 - left))
    weights = np.array(noises) ** -2.0
    share = float(np.average(shares, weights=weights))
    scatter = float(np.sqrt(np.average((np.array(shares) - share) ** 2, weights=weights)))
    random = math.hypot(1 / math.sqrt(weights.sum()), scatter / math.sqrt(max(len(shares) - 1, 1)))
    sigma = math.hypot(random, _EXPECTED_SHARE_ERROR * float(np.average(expected, weights=weights)))
    return ZerothOrder(share, sigma, tuple(shares))


def zeroth_order_share(field: NDArray[np.complexfloating]) -> float:
    """Share of modulated light that stays in the centre, of a field (rows, columns) whose
    amplitude is one where no light is lost."""
    return float(np.abs(field.mean()) ** 2)
