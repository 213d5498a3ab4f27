"""Find a phase pattern for spots by the weighted Gerchberg-Saxton algorithm.

References: Di Leonardo, Ianni and Ruocco, Opt. Express 15, 1913, 2007; Kim et al., Opt. Lett. 44,
3178, 2019 (the phases of the spots are fixed after some iterations). Only the centres of the spots
are constrained, and the light between them is free. For a continuous shape, vortices would fill
that free space, so such a target is refused.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage
import torch

from optics.progress import Progress
from optics.retrieval.far_field import unit_modulus
from optics.retrieval.goal import OVERSAMPLING, RetrievalGoal
from optics.retrieval.superpixel import Superpixels

_WIDEST = 5 * OVERSAMPLING // 2
"""Largest full width at half maximum of a spot, in samples.

A panel that is twice as wide as high can't make a spot narrower than four samples.
"""


def find_spots(goal: RetrievalGoal) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Find the spots of a target: rows, columns, and shares of the light.

    Raises ValueError for a target with a part that is larger than a spot.
    """
    target = goal.target.numpy()
    # The threshold is half of the local maximum, so that dim spots are found as well. Nothing
    # below 2 % of the brightest spot's peak counts as a spot.
    peak = scipy.ndimage.maximum_filter(target, 2 * _WIDEST + 1, mode="constant")
    bright = (target > 0.5 * peak) & (target > 0.02 * target.max())
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
    """Find the field at a target's spots by weighted Gerchberg-Saxton iterations.

    It is on the window, and zero except at the spots.
    """
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
        # A spot with less light than its share gets more weight.
        scale = (size * amplitude).sum() / amplitude.square().sum()
        weights = weights * (scale * amplitude / size.clamp(min=1e-3 * float(size.max())))
        weights = weights / weights.norm()
        # After 8 iterations the phases of the spots are fixed.
        phases = unit_modulus(at_spots) if iteration < 8 else unit_modulus(values)
        values = phases * weights
    return _window(pixels, rows, columns, values)


def _window(
    pixels: Superpixels, rows: torch.Tensor, columns: torch.Tensor, values: torch.Tensor
) -> torch.Tensor:
    """Return the field on the window, zero except at the spots."""
    window = torch.zeros(pixels.goal.plane.shape, dtype=values.dtype)
    window[rows, columns] = values
    return window
