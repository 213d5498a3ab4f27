"""Light of the gap between a panel's pixels, which no pattern changes."""

from __future__ import annotations

from optics.slm.panel import Panel


def gap_amplitude(panel: Panel) -> float:
    """Compute the amplitude that the gap adds to a pixel's field, relative to the pixel's.

    The gap is a frame with (1 - F) / F of the active area of a pixel with fill factor F. Its light
    adds coherently. The amplitude is exact on the axis. A PSFOperator spreads this light like that
    of the pixel's active square, although a frame spreads it differently. At a share u of the way
    to the panel's first diffraction order, along an axis, the error of the field is gap_reflection
    times (sinc(u) - sinc(u sqrt(F))) / F. For F = 0.87 this factor is 0.015 at a quarter and 0.05
    at half of the way. In the first order itself a bright gap would weaken the light, while it
    strengthens the light in this model.
    """
    return panel.gap_reflection * (1 - panel.fill_factor) / panel.fill_factor


def max_gap_power(panel: Panel) -> float:
    """Return the largest power of the field with gaps, over that of the pixels alone."""
    return (1 + gap_amplitude(panel)) ** 2
