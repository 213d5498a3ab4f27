"""Find the phase of one frame by Gerchberg-Saxton iterations and variants (thesis §3.3.2).

In every iteration of Gerchberg and Saxton (Optik 35, 237, 1972), the panel's amplitude and the
target's amplitude replace those of the wave, whose phases are kept. Two variants of the constraint
on the image have proved to be better, and are included, and a third is for spots alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.ndimage
import torch

from optics.camera import Camera
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval.far_field import unit_modulus
from optics.retrieval.goal import OVERSAMPLING, RetrievalGoal
from optics.retrieval.superpixel import Superpixels, starting_field
from optics.threads import single_threaded
from optics.validation import accepts_numpy, require_count

Constraint = Callable[[torch.Tensor], torch.Tensor]
"""Type of a function from the field on the window to the requested field there."""


def amplitude_constraint(intensity: torch.Tensor) -> Constraint:
    """Request the target's amplitude with the field's phase, as Gerchberg and Saxton do."""
    amplitude = torch.sqrt(intensity)
    return lambda field: unit_modulus(field) * amplitude


def over_compensated_constraint(intensity: torch.Tensor, gain: float = 1.0) -> Constraint:
    """Request amplitudes that over-compensate the field's errors.

    For an amplitude a and a target amplitude A, the constraint requests A + gain (A - a), at least
    0. Fienup (Appl. Opt. 21, 2758, 1982) calls such feedback algorithms input-output algorithms.
    """
    amplitude = torch.sqrt(intensity)

    def constrain(field: torch.Tensor) -> torch.Tensor:
        asked = ((1 + gain) * amplitude - gain * field.abs()).clamp(min=0)
        return unit_modulus(field) * torch.where(amplitude > 0, asked, amplitude)

    return constrain


def mixed_region_constraint(intensity: torch.Tensor, freedom: float) -> Constraint:
    """Request the target where it is bright, and leave freedom where it is dark.

    MRAF, mixed-region amplitude freedom: Pasienski and DeMarco, Opt. Express 16, 2176, 2008.
    freedom: share of the amplitude that dark samples of the window keep, from 0 to below 1. More
    freedom gives less speckle and more light in dark samples.
    """
    if not 0 <= freedom < 1:
        raise ValueError(f"freedom is {freedom:g}; it must lie between 0 and 1, and not be 1")
    amplitude = torch.sqrt(intensity)
    # Samples above 2 % of the target's peak belong to the signal region.
    signal = intensity > 0.02 * intensity.max()

    def constrain(field: torch.Tensor) -> torch.Tensor:
        asked = (1 - freedom) * unit_modulus(field) * amplitude
        return torch.where(signal, asked, freedom * field)

    return constrain


def iterate_constraint(
    pixels: Superpixels,
    field: torch.Tensor,
    constrain: Constraint,
    iterations: int,
    progress: Progress,
    name: str,
) -> torch.Tensor:
    """Iterate between panel and window; return the last constrained field.

    The result is on the window. field: the starting field on the panel. name: the method's name in
    progress reports.
    """
    asked = constrain(pixels.far_field.forward(field))
    for iteration in range(1, iterations):
        progress.report(iteration / iterations, f"{name} {iteration + 1}/{iterations}")
        asked = constrain(pixels.far_field.round_trip(asked, pixels.uneven_amplitude))
    return asked


@accepts_numpy
@single_threaded
def gerchberg_saxton(
    camera: Camera,
    target: torch.Tensor,
    plane: Plane,
    wavelength: float,
    *,
    iterations: int,
    generator: torch.Generator,
    start: str = "quadratic",
    progress: Progress | None = None,
) -> torch.Tensor:
    """Find a phase pattern by plain Gerchberg-Saxton iterations on every pixel of the panel.

    It is meant for comparisons and for small panels; `retrieve` is faster and better (thesis
    §3.3.2; R. W. Gerchberg and W. O. Saxton, Optik 35, 237, 1972). Returns phases in radians,
    (rows, columns) float32. Raises ValueError for a target that is empty or negative, or has
    another shape than the plane.

    target: intensity on `plane`, (rows, columns), on any positive scale, nowhere negative; zero is
        meant beyond it.
    plane: samples in the focal plane, from ``design_plane(camera, wavelength, ...)``.
    wavelength: metres.
    start: phases that the iterations start from, one of `STARTS`.
    """
    require_count("iterations", iterations)
    goal = RetrievalGoal(camera, target, plane, wavelength)
    pixels = Superpixels(goal, 1)
    field = starting_field(pixels, start, generator)
    constrain = amplitude_constraint(pixels.target_intensity)
    progress, name = progress or Progress(), "Gerchberg-Saxton"
    asked = iterate_constraint(pixels, field, constrain, iterations, progress, name)
    return pixels.pixel_phases(asked)


# Largest full width at half maximum of a spot, in samples.
#
# A panel that is twice as wide as high can't make a spot narrower than four samples.
_WIDEST = 5 * OVERSAMPLING // 2


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

    It is on the window, and zero except at the spots (Di Leonardo, Ianni and Ruocco, Opt. Express
    15, 1913, 2007; Kim et al., Opt. Lett. 44, 3178, 2019: the phases of the spots are fixed after
    some iterations). Only the centres of the spots are constrained, and the light between them is
    free. For a continuous shape, vortices would fill that free space, so such a target is refused.
    """
    rows, columns, shares = find_spots(pixels.goal)
    amplitude = torch.sqrt(shares).to(torch.float32)
    weights = amplitude.clone()
    turns = torch.rand(len(shares), generator=generator) * 2 * torch.pi
    values = torch.polar(weights, turns)
    window = torch.zeros(pixels.goal.plane.shape, dtype=values.dtype)
    for iteration in range(iterations):
        progress.report(iteration / iterations, f"weighted spots {iteration + 1}/{iterations}")
        window[rows, columns] = values
        seen = pixels.far_field.round_trip(window, pixels.uneven_amplitude)
        at_spots = seen[rows, columns]
        size = at_spots.abs()
        # A spot with less light than its share gets more weight.
        scale = (size * amplitude).sum() / amplitude.square().sum()
        weights = weights * (scale * amplitude / size.clamp(min=1e-3 * float(size.max())))
        weights = weights / weights.norm()
        # After 8 iterations the phases of the spots are fixed.
        phases = unit_modulus(at_spots) if iteration < 8 else unit_modulus(values)
        values = phases * weights
    window[rows, columns] = values
    return window
