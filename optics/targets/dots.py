"""Draw dots and a ring, compute positions for dots, and move one by the wavelength."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.plane import Plane
from optics.targets.target import Drawing, Drawings, Target, format_micrometres
from optics.validation import require_positive, require_wavelength

Position = tuple[float, float]
"""(y, x) in metres."""


@Target
def dots(
    positions: Sequence[Position], width: float, weights: Sequence[float] | None = None
) -> Drawing:
    """Draw Gaussian dots at given positions; overlapping dots add up.

    Parameters
    ----------
    positions : sequence of tuple of float
        (y, x) of each dot in metres, one or more.
    width : float
        Standard deviation of a dot, metres.
    weights : sequence of float, optional
        Light of each dot, positive, on any scale; all dots are equal if None.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.

    Raises
    ------
    ValueError
        If there is no dot, a position isn't a finite pair, a weight isn't positive, or the number
        of weights differs from the number of dots.
    """
    require_positive("width", width, "m")
    weights = [1.0] * len(positions) if weights is None else weights
    if not positions:
        raise ValueError("positions is empty; give one dot at least")
    if len(weights) != len(positions):
        raise ValueError(f"weights has {len(weights)} values for {len(positions)} positions")
    for weight in weights:
        require_positive("a weight", weight, "")
    place = torch.tensor(positions, dtype=torch.float64)
    if place.shape != (len(positions), 2) or not torch.isfinite(place).all():
        raise ValueError("positions must be finite pairs (y, x)")
    light = torch.tensor(weights, dtype=torch.float64)

    def brightness(plane: Plane) -> torch.Tensor:
        # Of each dot the profile along an axis, (samples, dots).
        away = (plane.coordinates(axis)[:, None] - place[:, axis] for axis in (0, 1))
        y, x = (torch.exp(-(one**2) / (2 * width**2)) for one in away)
        return (y * light) @ x.T

    (low_y, low_x), (high_y, high_x) = place.min(0).values.tolist(), place.max(0).values.tolist()
    return Drawing(
        (low_y, high_y, low_x, high_x),
        width,
        brightness,
        f"a dot {format_micrometres(float(place.abs().max()))} from the axis with width "
        f"{format_micrometres(width)}",
        "move it inwards",
    )


@Target
def ring(radius: float, width: float) -> Drawing:
    """Draw a ring with a Gaussian profile; a radius of zero gives a spot.

    Parameters
    ----------
    radius, width : float
        Radius of the brightest circle, 0 or more, and standard deviation of the profile, metres.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.

    Raises
    ------
    ValueError
        If the radius is negative, the width isn't positive, or one of them isn't finite.
    """
    if not (0 <= radius < math.inf and 0 < width < math.inf):
        raise ValueError(f"radius {radius:g} m and width {width:g} m must be positive")

    def brightness(plane: Plane) -> torch.Tensor:
        y, x = plane.mesh()
        return torch.exp(-((torch.hypot(y, x) - radius) ** 2) / (2 * width**2))

    return Drawing(
        (-radius, radius, -radius, radius),
        width,
        brightness,
        f"radius {format_micrometres(radius)} with width {format_micrometres(width)}",
        "choose a smaller radius",
    )


def ring_positions(count: int, radius: float, start: float = 0.0) -> list[Position]:
    """Compute positions that are equally spaced on a circle.

    Parameters
    ----------
    count : int
        Number of positions, 1 or more.
    radius : float
        Radius of the circle, metres.
    start : float, default 0.0
        Angle of the first position in radians, from x towards y.

    Returns
    -------
    list of tuple of float
        (y, x) of each position in metres.

    Raises
    ------
    ValueError
        If the count is below 1, or the radius isn't positive.
    """
    if count < 1:
        raise ValueError(f"count is {count}; give one dot at least")
    require_positive("radius", radius, "m")
    angles = [start + 2 * math.pi * k / count for k in range(count)]
    return [(radius * math.sin(angle), radius * math.cos(angle)) for angle in angles]


def grid_positions(shape: tuple[int, int], spacing: float) -> list[Position]:
    """Compute positions on a rectangular grid around the axis.

    Parameters
    ----------
    shape : tuple of int
        (rows, columns), each 1 or more.
    spacing : float
        Distance between neighbours, metres.

    Returns
    -------
    list of tuple of float
        (y, x) of each position in metres, row by row.

    Raises
    ------
    ValueError
        If there is no row or column, or the spacing isn't positive.
    """
    if min(shape) < 1:
        raise ValueError(f"shape is {shape}; give one row and one column at least")
    require_positive("spacing", spacing, "m")
    y, x = ([(i - (n - 1) / 2) * spacing for i in range(n)] for n in shape)
    return [(row, column) for row in y for column in x]


def dispersed_positions(
    wavelengths: Sequence[float], reference: float, rate: float, direction: float = 0.0
) -> list[Position]:
    """Compute where a prism sends wavelengths: positions in a row on the sensor (thesis Fig. 4.2).

    Parameters
    ----------
    wavelengths : sequence of float
        Metres, one or more.
    reference : float
        Wavelength in metres that stays on the axis.
    rate : float
        Metres on the sensor per metre of wavelength: 1000 for a micrometre per nanometre.
    direction : float, default 0.0
        Angle in radians from x towards y, towards which longer waves move.

    Returns
    -------
    list of tuple of float
        (y, x) of each wavelength in metres.

    Raises
    ------
    ValueError
        If there is no wavelength, one isn't positive, or the rate or the direction isn't finite.
    """
    if not wavelengths:
        raise ValueError("wavelengths is empty; give one at least")
    for wavelength in (*wavelengths, reference):
        require_wavelength("wavelength", wavelength)
    if not (math.isfinite(rate) and math.isfinite(direction)):
        raise ValueError(f"rate {rate:g} and direction {direction:g} rad must be finite")
    shifts = [rate * (wavelength - reference) for wavelength in wavelengths]
    return [(shift * math.sin(direction), shift * math.cos(direction)) for shift in shifts]


@Target
def linear_dispersion(
    wavelengths: Sequence[float],
    reference: float,
    rate: float,
    width: float,
    direction: float = 0.0,
) -> Drawings:
    """Draw what a prism makes of a point: one dot per wavelength, each in a picture of its own.

    The result is (wavelengths, rows, columns).

    Parameters
    ----------
    wavelengths : sequence of float
        Metres, one or more.
    reference, rate : float
        Wavelength in metres that stays on the axis, and metres on the sensor per metre of
        wavelength; see `dispersed_positions`.
    width : float
        Standard deviation of a dot, metres.
    direction : float, default 0.0
        Angle in radians from x towards y, towards which longer waves move.

    Returns
    -------
    Drawings
        One picture per wavelength, which `Target` puts on a plane.
    """
    places = dispersed_positions(wavelengths, reference, rate, direction)
    return Drawings([dots.draw([place], width) for place in places])
