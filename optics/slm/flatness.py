"""Compute the phase of the panel's flatness, which the light gets whatever pattern is shown."""

from __future__ import annotations

import math

import torch

from optics.slm.panel import Panel


def flatness_phase(panel: Panel, wavelength: float) -> torch.Tensor:
    """Compute the phase of an SLM's known flatness in radians, (rows, columns) float64.

    Flatness is an optical path, so that its phase is proportional to 1/wavelength.
    """
    assert panel.flatness is not None
    return panel.flatness.at_pixels(panel) * (2 * math.pi / wavelength)
