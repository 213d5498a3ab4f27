"""The frame between the pixels, whose light no pattern changes."""

from __future__ import annotations

from optics.slm.panel import Panel


def gap_amplitude(panel: Panel) -> float:
    """What the frame adds to a pixel's field, relative to the pixel's own area: amplitude.

    The frame has (1 - F) / F of the area of a pixel whose fill factor is F, and adds
    coherently. Exact on the axis. A PSFOperator spreads this light like that of the pixel's
    square, which a frame doesn't: at a share u of the way to the panel's first diffraction
    order, along an axis, the field is wrong by gap_reflection times
    (sinc(u) - sinc(u sqrt(F))) / F, which is 0.015 at a quarter and 0.05 at half of the way
    for F = 0.87. In the first order itself a bright frame would weaken the light, and here
    strengthens it.
    """
    return panel.gap_reflection * (1 - panel.fill_factor) / panel.fill_factor
