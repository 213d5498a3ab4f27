"""The share of the light that no pattern moves out of the zeroth order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ZerothOrder:
    """The share of the light that no pattern moves.

    sigma: standard deviation of the share.
    by_frame: the share according to each frame.
    """

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
    """Measure the light that gratings leave in the centre, relative to a neutral pattern.

    neutral_picture: light less its dark frame, (rows, columns), of a pattern that leaves all light
        in the centre.
    steered_pictures: those of gratings that send the light away, at the same exposure time.
    variance: that of each picture's difference from the expected one.
    expected: share of the modulated light that each grating leaves in the centre by itself,
        according to the calibrated response.
    centre: (y, x) pixel.
    usable: pixels neither clipped nor hot.

    The spot in the centre has the same shape in all pictures, so the neutral picture is used as the
    weight. Raises ValueError if the neutral picture is dark in the centre, or no grating was shown.
    """
    if not steered_pictures or not len(steered_pictures) == len(variance) == len(expected):
        raise ValueError(
            f"{len(steered_pictures)} steered pictures, {len(variance)} variances and "
            f"{len(expected)} expected shares; give one of each for every grating"
        )
    reach = 6  # The window has 6 pixels on each side of the centre.
    part = tuple(slice(max(round(c) - reach, 0), round(c) + reach + 1) for c in centre)
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
    # The expected shares are taken as uncertain by a fifth.
    sigma = math.hypot(random, 0.2 * float(np.average(expected, weights=weights)))
    return ZerothOrder(share, sigma, tuple(shares))


def zeroth_order_share(field: NDArray[np.complexfloating]) -> float:
    """Compute the share of modulated light that a pattern leaves in the zeroth order.

    field: (rows, columns) on the panel, with amplitude 1 where no light is lost.
    """
    return float(np.abs(field.mean()) ** 2)
