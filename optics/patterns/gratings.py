"""Periodic patterns, and those that shift the whole picture. Periods in panel pixels."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel
from optics.patterns.slope import require_slope
from optics.validation import require_positive, rounded_down, rounded_up

_FEWEST = 4.0
"""Pixels in a period of a sine: with fewer, its crests may fall between pixels."""

__all__ = ["binary_grating", "blazed_grating", "sine_grating", "steering_grating"]


def blazed_grating(panel: Panel, period: float, direction: float = 0.0) -> torch.Tensor:
    """A ramp of one wave per period, which sends all light to one side.

    period: panel pixels. direction: radians from x towards y, in which the phase grows. Raises
    ValueError with the shortest period that the pixels allow: two along rows or columns, less
    between them.
    """
    _require_period(period, direction)
    steepest = max(abs(math.cos(direction)), abs(math.sin(direction)))
    shortest = rounded_up(2 * steepest)
    require_slope("period", 2 * math.pi * steepest / period, f"choose at least {shortest} pixels")
    return 2 * math.pi * _along(panel, direction) / period


def steering_grating(
    panel: Panel, shift: tuple[float, float], distance: float, wavelength: float
) -> torch.Tensor:
    """The blazed grating that shifts the PSF on the sensor.

    shift: (y, x) in metres. distance: metres from the lens to the sensor. Raises ValueError
    with the largest shift that the pixels allow: wavelength x distance / (2 pitch) an axis.
    """
    require_positive("distance", distance, "m")
    require_positive("wavelength", wavelength, "m")
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
    """Stripes of phase 0 and `step`, equally wide: with pi, no light stays in the middle.

    period: of both stripes, panel pixels, 2 at least. direction: radians from x towards y, across
    the stripes. The origin begins a stripe of phase 0.
    """
    _require_period(period, direction)
    if not math.isfinite(step):
        raise ValueError(f"step is {step} rad; it must be finite")
    if period < 2:
        raise ValueError(f"period is {period:g} pixels; stripes need at least 2")
    turns = _along(panel, direction) / period
    # Pixels on a boundary belong to the stripe that begins there, whatever rounding says.
    turns = torch.floor(2 * turns + 1e-9)
    return step * (turns - 2 * torch.floor(turns / 2))


def sine_grating(
    panel: Panel, amplitude: float, period: float, direction: float = 0.0
) -> torch.Tensor:
    """A wave of phase, which bends light to and fro (thesis section 6.4: low and high).

    amplitude: radians, from the mean to a crest. period: panel pixels, 4 at least. direction:
    radians from x towards y, in which it waves; zero at the origin, and growing. Raises
    ValueError with the greatest amplitude that the pixels allow.
    """
    _require_period(period, direction)
    if not math.isfinite(amplitude):
        raise ValueError(f"amplitude is {amplitude} rad; it must be finite")
    if period < _FEWEST:
        raise ValueError(
            f"period is {period:g} pixels; choose at least {_FEWEST:g}, so that crests are shown"
        )
    steepest = max(abs(math.cos(direction)), abs(math.sin(direction))) * 2 * math.pi / period
    most = rounded_down(math.pi / steepest)
    remedy = f"choose at most {most} rad in size, or a longer period"
    require_slope("amplitude", abs(amplitude) * steepest, remedy)
    return amplitude * torch.sin(2 * math.pi * _along(panel, direction) / period)


def _require_period(period: float, direction: float) -> None:
    require_positive("period", period, "pixels")
    if not math.isfinite(direction):
        raise ValueError(f"direction is {direction} rad; it must be finite")


def _along(panel: Panel, direction: float) -> torch.Tensor:
    """Pixels from the origin in a direction."""
    y, x = (axis / panel.pitch for axis in panel.plane.mesh())
    return math.cos(direction) * x + math.sin(direction) * y
