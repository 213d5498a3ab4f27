"""Weighted Gerchberg-Saxton, for targets that are made of spots.

Di Leonardo, Ianni and Ruocco, Opt. Express 15, 1913, 2007; Kim et al., Opt. Lett. 44, 3178,
2019 (the phases are kept once the spots are found). Only the spots' middles are asked for, and
what lies between them is free; for a continuous shape that freedom is filled with vortices, so
that such a target is refused.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage
import torch

from optics.progress import Progress
from optics.retrieval.far_field import unit_modulus
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.grid import OVERSAMPLING
from optics.retrieval.superpixel import Superpixels

_WIDEST = 5 * OVERSAMPLING // 2
"""Samples across the brighter half of what still counts as a spot: a panel twice as wide as
high can't make it narrower than four."""

_FAINT = 0.02
"""Share of the brightest spot's peak below which nothing is one."""

_FREE = 8
"""Iterations until the phases are kept."""


def find_spots(goal: RetrievalGoal) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Rows and columns of the target's spots on the window, and their shares of the light.

    Raises ValueError for a target with anything larger than a spot.
    """
    target = goal.target.numpy()
    # Half of the brightest nearby, so that a dim spot is one as well as a bright one.
    peak = scipy.ndimage.maximum_filter(target, 2 * _WIDEST + 1, mode="constant")
    bright = (target > 0.5 * peak) & (target > _FAINT * target.max())
    labels, count = scipy.ndimage.label(bright, np.ones((3, 3)))
    for part in scipy.ndimage.find_objects(labels):
        widest = max(axis.stop - axis.start for axis in part)
        if widest > _WIDEST:
            raise ValueError(
                f"the target has a part {widest} samples wide, and a spot has {_WIDEST} at most; "
                "weighted Gerchberg-Saxton is for spots: choose another method"
            )
    numbers = np.arange(1, count + 1)
    middles = np.array(scipy.ndimage.center_of_mass(target, labels, numbers))
    powers = np.atleast_1d(scipy.ndimage.sum(target, labels, numbers))
    rows, columns = np.rint(middles).astype(int).T
    shares = powers / powers.sum()
    return torch.from_numpy(rows), torch.from_numpy(columns), torch.from_numpy(shares)


def weighted_spots_field(
    pixels: Superpixels, iterations: int, generator: torch.Generator, progress: Progress
) -> torch.Tensor:
    """The field on the window, zero but at the spots, of a pattern that gives them their light."""
    rows, columns, shares = find_spots(pixels.goal)
    amplitude = torch.sqrt(shares).to(torch.float32)
    weights = amplitude.clone()
    turns = torch.rand(len(shares), generator=generator) * 2 * torch.pi
    values = torch.polar(weights, turns)
    for iteration in range(iterations):
        progress.report(iteration / iterations, f"weighted spots {iteration + 1}/{iterations}")
        seen = pixels.far_field.round_trip(
            _window(pixels, rows, columns, values), pixels.uneven_amplitude
        )
        at_spots = seen[rows, columns]
        size = at_spots.abs()
        # A spot that is too dim for its share gets more weight.
        scale = (size * amplitude).sum() / amplitude.square().sum()
        weights = weights * (scale * amplitude / size.clamp(min=1e-3 * float(size.max())))
        weights = weights / weights.norm()
        phases = unit_modulus(at_spots) if iteration < _FREE else unit_modulus(values)
        values = phases * weights
    return _window(pixels, rows, columns, values)


def _window(
    pixels: Superpixels, rows: torch.Tensor, columns: torch.Tensor, values: torch.Tensor
) -> torch.Tensor:
    window = torch.zeros(pixels.goal.plane.shape, dtype=values.dtype)
    window[rows, columns] = values
    return window
