"""Find the phase of one frame by Gerchberg-Saxton iterations and variants (thesis §3.3.2).

In every iteration of Gerchberg and Saxton (Optik 35, 237, 1972), the panel's amplitude and the
target's amplitude replace those of the wave, whose phases are kept. Two variants of the constraint
on the image have proved to be better, and are included.
"""

from __future__ import annotations

from collections.abc import Callable

import torch

from optics.camera import Camera
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval.far_field import unit_modulus
from optics.retrieval.goal import RetrievalGoal
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
