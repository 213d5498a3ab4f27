"""The panel's own figure: optical path that light gets whatever is shown."""

from __future__ import annotations

import math

import torch

from optics.slm.panel import Panel


def flatness_phase(panel: Panel, wavelength: float) -> torch.Tensor:
    """Phase in radians, (rows, columns) float64, of a panel whose flatness is known.

    A mirror's figure is a path, so that its phase goes as 1/wavelength.
    """
    assert panel.flatness is not None
    return panel.flatness.at_pixels(panel) * (2 * math.pi / wavelength)
