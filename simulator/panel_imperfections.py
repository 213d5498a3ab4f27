"""Imperfections of a panel: phase response, flatness and illumination."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import torch

from optics.camera import Panel
from optics.slm import PanelMap, PhaseResponse
from optics.zernike import zernike


def nonlinear_response(levels: int, gamma: float, wiggle: float, highest: float) -> PhaseResponse:
    """Return a phase response that bends and wiggles over the grey levels.

    The phase is `highest` times (x^gamma + wiggle sin 2πx), x from 0 to 1 over the grey levels.
    Raises ValueError for a phase that falls from one level to the next.
    """
    x = np.linspace(0, 1, levels)
    # A response of one wavelength holds at all wavelengths; 550 nm has no further meaning.
    return PhaseResponse.from_curve(550e-9, highest * (x**gamma + wiggle * np.sin(2 * np.pi * x)))


def flatness_map(panel: Panel, terms: Iterable[tuple[int, int, float]]) -> PanelMap:
    """Return a panel's flatness as a sum of Zernike polynomials on its circumscribed circle.

    terms: (degree n, order m, metres rms) of each polynomial.
    """
    reach = 0.5 * panel.pitch * math.hypot(*panel.shape)
    y, x = (position / reach for position in panel.plane.mesh())
    path = torch.zeros(panel.shape, dtype=torch.float64)
    for n, m, strength in terms:
        path = path + strength * zernike(n, m, y, x)
    return PanelMap(path)


def illumination_map(panel: Panel, radius: float, centre: tuple[float, float]) -> PanelMap:
    """Return a Gaussian beam's irradiance on a panel, 1 at its centre.

    radius: to 1/e² of the peak, in metres. centre: (y, x) in metres.
    """
    y, x = panel.plane.mesh()
    away = (y - centre[0]) ** 2 + (x - centre[1]) ** 2
    return PanelMap(torch.exp(-2 * away / radius**2))
