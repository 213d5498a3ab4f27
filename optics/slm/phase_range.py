"""Compute a panel's phase range at a wavelength."""

from __future__ import annotations

import functools
import math

import numpy as np

from optics.slm.panel import Panel
from optics.validation import require_wavelength


def max_phase(panel: Panel, wavelength: float) -> float:
    """Compute an SLM's phase at the highest grey level, at a wavelength.

    The optical path difference of a nematic cell follows its birefringence, which the extended
    Cauchy equation A + B/wavelength² + C/wavelength⁴ describes across the visible. As many terms
    are used as the panel has tabulated wavelengths, at most three.

    Parameters
    ----------
    panel : Panel
        The panel.
    wavelength : float
        Metres, 0.9 times the smallest to 1.15 times the largest tabulated wavelength.

    Returns
    -------
    float
        Radians.

    Raises
    ------
    ValueError
        If the wavelength is outside that range, or the fitted optical path is not positive there.

    References
    ----------
    J. Li and S.-T. Wu, J. Appl. Phys. 95, 896, 2004, doi 10.1063/1.1635971.
    """
    table = panel.max_phase
    known = [w for w, _ in table]
    if 0 < wavelength < math.inf:
        require_wavelength("wavelength", wavelength)
    low, high = 0.9 * min(known), 1.15 * max(known)
    if not low <= wavelength <= high:
        raise ValueError(
            f"wavelength {wavelength * 1e9:.0f} nm is outside the panel's table; "
            f"choose {low * 1e9:.0f} to {high * 1e9:.0f} nm, or add its phase range there"
        )
    unit, coefficients = _cauchy(table)
    path = float(np.polyval(coefficients, (unit / wavelength) ** 2))
    if path <= 0:
        raise ValueError(
            f"max_phase leaves no phase at {wavelength * 1e9:.0f} nm: the path through its "
            "entries is no dispersion of a liquid crystal; check them, or add one there"
        )
    return path / wavelength


@functools.lru_cache(maxsize=64)
def _cauchy(table: tuple[tuple[float, float], ...]) -> tuple[float, tuple[float, ...]]:
    """Fit the Cauchy equation of the liquid crystal's path over wavelengths.

    Returns the wavelength that serves as the unit, and the coefficients of the powers of (unit /
    wavelength)².
    """
    known, path = np.array([(w, phase * w) for w, phase in sorted(table)]).T
    unit = float(known.mean())
    coefficients = np.polyfit((unit / known) ** 2, path, min(len(table), 3) - 1)
    return unit, tuple(coefficients.tolist())
