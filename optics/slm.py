"""What the panel does: from grey levels to phase at a wavelength, and back."""

from __future__ import annotations

import math

import numpy as np
import torch

from optics.camera import Panel
from optics.edge import require_finite, tensors_inside


def max_phase(panel: Panel, wavelength: float) -> float:
    """Phase in radians at the highest grey level, at a wavelength in metres.

    The optical path difference of a nematic cell follows its birefringence, which the
    extended Cauchy equation A + B/wavelength² + C/wavelength⁴ describes across the
    visible (Li and Wu, J. Appl. Phys. 95, 896, 2004, doi 10.1063/1.1635971). As many
    terms are used as the panel has tabulated wavelengths, at most three.

    Raises ValueError outside 0.9 to 1.15 times the tabulated wavelengths.
    """
    table = sorted(panel.max_phase)
    low, high = 0.9 * table[0][0], 1.15 * table[-1][0]
    if not low <= wavelength <= high:
        raise ValueError(
            f"wavelength {wavelength * 1e9:.0f} nm is outside the panel's table; "
            f"choose {low * 1e9:.0f} to {high * 1e9:.0f} nm, or add its phase range there"
        )
    known = np.array([w for w, _ in table])
    path = np.array([phase * w for w, phase in table])
    unit = known.mean()
    terms = min(len(table), 3)
    coefficients = np.polyfit((unit / known) ** 2, path, terms - 1)
    return float(np.polyval(coefficients, (unit / wavelength) ** 2) / wavelength)


@tensors_inside
def grey_to_phase(panel: Panel, grey: torch.Tensor, wavelength: float) -> torch.Tensor:
    """Phase in radians, float64, of grey levels shown on the panel (linear response)."""
    return grey.to(torch.float64) * (max_phase(panel, wavelength) / (panel.levels - 1))


@tensors_inside
def phase_to_grey(panel: Panel, phase: torch.Tensor, wavelength: float) -> torch.Tensor:
    """Grey levels, uint8, nearest to a phase in radians modulo one wave.

    Only the first 2 pi of the panel's range is used, so that neighbouring phases are
    neighbouring levels. Raises ValueError if the panel can't reach one wave, or for a
    phase that isn't finite.
    """
    require_finite("phase", phase)
    reach = max_phase(panel, wavelength)
    if reach < 2 * math.pi * (1 - 1 / panel.levels):
        raise ValueError(
            f"the panel reaches {reach / math.pi:.2f} pi at {wavelength * 1e9:.0f} nm and a "
            "pattern needs 2 pi; choose a shorter wavelength"
        )
    levels_per_wave = 2 * math.pi * (panel.levels - 1) / reach
    turns = phase.to(torch.float64) / (2 * math.pi)
    level = torch.round((turns - torch.floor(turns)) * levels_per_wave)
    return level.clamp(max=panel.levels - 1).to(torch.uint8)


def require_grey(panel: Panel, grey: np.ndarray) -> None:
    """Raise ValueError or TypeError if an array is no picture for this panel."""
    if grey.dtype != np.uint8:
        raise TypeError(f"the pattern's type is {grey.dtype}; the panel shows uint8 grey levels")
    if grey.shape != panel.shape:
        raise ValueError(
            f"the pattern is {grey.shape[-1]}x{grey.shape[0]} pixels; "
            f"the panel needs {panel.shape[1]}x{panel.shape[0]}"
            if grey.ndim == 2
            else f"the pattern has {grey.ndim} axes; the panel needs rows and columns"
        )
    if grey.max() >= panel.levels:
        raise ValueError(
            f"the pattern has level {grey.max()}; the panel's levels are 0 to {panel.levels - 1}"
        )
