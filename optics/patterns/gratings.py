"""Gratings: periodic ones, and one that shifts the whole picture. Periods are in panel pixels."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel
from optics.patterns.slope import require_slope
from optics.validation import require_positive, require_wavelength, rounded_down, rounded_up

__all__ = ["binary_grating", "blazed_grating", "sine_grating", "steering_grating"]


def blazed_grating(panel: Panel, period: float, direction: float = 0.0) -> torch.Tensor:
    """Compute a blazed grating, which sends all light into one order.

    The phase is a ramp of one wave per period.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    period : float
        Panel pixels; at least 2 along rows or columns, and less at other directions.
    direction : float, default 0.0
        Angle in radians from x towards y, in which the phase grows.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If the period isn't positive, or the phase is too steep; the message names the shortest
        period.
    """
    _require_period(period, direction)
    steepest = max(abs(math.cos(direction)), abs(math.sin(direction)))
    shortest = rounded_up(2 * steepest)
    require_slope("period", 2 * math.pi * steepest / period, f"choose at least {shortest} pixels")
    return 2 * math.pi * _distance_along(panel, direction) / period


def steering_grating(
    panel: Panel, shift: tuple[float, float], distance: float, wavelength: float
) -> torch.Tensor:
    """Compute the blazed grating that shifts the PSF on the sensor by a distance.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    shift : tuple of (float, float)
        (y, x) in metres on the sensor; along each axis at most
        wavelength x distance / (2 pitch).
    distance : float
        Metres from the lens to the sensor.
    wavelength : float
        Metres.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If a length is invalid, or the phase is too steep; the message names the largest shift.
    """
    require_positive("distance", distance, "m")
    require_wavelength("wavelength", wavelength)
    if not all(math.isfinite(s) for s in shift):
        raise ValueError(f"shift {shift} m must be finite in each axis")
    scale = 2 * math.pi / (wavelength * distance)
    largest = rounded_down(math.pi / (scale * panel.pitch))
    step = scale * max(map(abs, shift)) * panel.pitch
    require_slope("shift", step, f"choose at most {largest} m in each axis")
    y, x = panel.plane.mesh()
    return scale * (shift[0] * y + shift[1] * x)


def binary_grating(
    panel: Panel, period: float, step: float, direction: float = 0.0
) -> torch.Tensor:
    """Compute a binary grating, equally wide stripes of phase 0 and `step`.

    With a step of pi no light stays in the zeroth order. A stripe of phase 0 begins at the origin.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    period : float
        Width of two stripes, panel pixels, 2 or more.
    step : float
        Radians.
    direction : float, default 0.0
        Angle in radians from x towards y, across the stripes.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If the period is below 2 pixels, or a number isn't finite.
    """
    _require_period(period, direction)
    if not math.isfinite(step):
        raise ValueError(f"step is {step} rad; it must be finite")
    if period < 2:
        raise ValueError(f"period is {period:g} pixels; stripes need at least 2")
    turns = _distance_along(panel, direction) / period
    # A pixel on a boundary belongs to the stripe that begins there. The small term keeps rounding
    # errors from deciding this.
    turns = torch.floor(2 * turns + 1e-9)
    return step * (turns - 2 * torch.floor(turns / 2))


def sine_grating(
    panel: Panel, amplitude: float, period: float, direction: float = 0.0
) -> torch.Tensor:
    """Compute a sinusoidal phase grating (thesis section 6.4).

    The phase is zero at the origin and grows there in `direction`.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    amplitude : float
        Radians from the mean to a crest.
    period : float
        Panel pixels, 4 or more.
    direction : float, default 0.0
        Angle in radians from x towards y, across the crests.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If the period is below 4 pixels, a number isn't finite, or the phase is too steep; the
        message names the largest amplitude.
    """
    _require_period(period, direction)
    if not math.isfinite(amplitude):
        raise ValueError(f"amplitude is {amplitude} rad; it must be finite")
    # With fewer than 4 pixels in a period, the crests may fall between pixels.
    if period < 4.0:
        raise ValueError(
            f"period is {period:g} pixels; choose at least 4, so that crests are shown"
        )
    steepest = max(abs(math.cos(direction)), abs(math.sin(direction))) * 2 * math.pi / period
    most = rounded_down(math.pi / steepest)
    remedy = f"choose at most {most} rad in size, or a longer period"
    require_slope("amplitude", abs(amplitude) * steepest, remedy)
    return amplitude * torch.sin(2 * math.pi * _distance_along(panel, direction) / period)


def _require_period(period: float, direction: float) -> None:
    require_positive("period", period, "pixels")
    if not math.isfinite(direction):
        raise ValueError(f"direction is {direction} rad; it must be finite")


def _distance_along(panel: Panel, direction: float) -> torch.Tensor:
    """Compute each pixel's distance from the panel's origin along a direction, in pixels."""
    y, x = (axis / panel.pitch for axis in panel.plane.mesh())
    return math.cos(direction) * x + math.sin(direction) * y
