"""Iterations between pupil and image for one frame (thesis §3.3.2).

Gerchberg and Saxton, Optik 35, 237, 1972: in every iteration the panel's amplitude and the
target's amplitude replace those of the wave, and its phases stay. Two changes of what is asked
of the image have proved to be better, and stand beside it.
"""

from __future__ import annotations

from collections.abc import Callable

import torch

from optics.camera import Camera
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval.far_field import unit_modulus
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.start_phases import starting_field
from optics.retrieval.superpixel import Superpixels
from optics.threads import single_threaded
from optics.validation import accepts_numpy, require_count

Constraint = Callable[[torch.Tensor], torch.Tensor]
"""From the field on the window to the one that is asked for."""

_SIGNAL = 0.02
"""Share of the target's peak from which a sample belongs to the signal."""


def amplitude_constraint(intensity: torch.Tensor) -> Constraint:
    """The target's amplitude with the field's phase, as published."""
    amplitude = torch.sqrt(intensity)
    return lambda field: unit_modulus(field) * amplitude


def over_compensated_constraint(intensity: torch.Tensor, gain: float = 1.0) -> Constraint:
    """Where the amplitude a is below the target's A, ask for A + gain (A - a), and for as much
    less where it is above: an error is answered by its opposite.

    Feedback on the amplitude (Fienup, Appl. Opt. 21, 2758, 1982, calls the family
    input-output algorithms).
    """
    amplitude = torch.sqrt(intensity)

    def constrain(field: torch.Tensor) -> torch.Tensor:
        asked = ((1 + gain) * amplitude - gain * field.abs()).clamp(min=0)
        return unit_modulus(field) * torch.where(amplitude > 0, asked, amplitude)

    return constrain


def mixed_region_constraint(intensity: torch.Tensor, freedom: float) -> Constraint:
    """MRAF: the target's amplitude where it is bright, and freedom where it is dark.

    Pasienski and DeMarco, Opt. Express 16, 2176, 2008. freedom: share of the amplitude that
    dark samples of the window may keep, 0 to 1; light there is the price of less speckle.
    """
    if not 0 <= freedom < 1:
        raise ValueError(f"freedom is {freedom:g}; it must lie between 0 and 1, and not be 1")
    amplitude = torch.sqrt(intensity)
    signal = intensity > _SIGNAL * intensity.max()

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
    """The constrained field on the window after some iterations from a field on the panel."""
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
    """A phase pattern whose PSF has the target's shape, (rows, columns) in radians, float32.

    The plain algorithm on every pixel of the panel, for comparison and for small panels;
    retrieve() is faster and better. target: intensity on `plane` (see design_plane), any
    positive scale; zero beyond it. start: one of STARTS. Raises ValueError for an
    empty or negative target, or one of another shape than the plane's.
    """
    require_count("iterations", iterations)
    goal = RetrievalGoal(camera, target, plane, wavelength)
    pixels = Superpixels(goal, 1)
    field = starting_field(goal, pixels, start, generator)
    asked = iterate_constraint(
        pixels,
        field,
        amplitude_constraint(pixels.target_intensity),
        iterations,
        progress or Progress(),
        "Gerchberg-Saxton",
    )
    return pixels.pixel_phases(asked)
