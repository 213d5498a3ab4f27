"""How a virtual bench may differ from its description."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import torch

from optics.camera import Panel
from optics.slm import PanelMap, PhaseResponse
from optics.zernike import zernike

_WAVELENGTH = 550e-9
"""Metres; one curve holds at all of them."""


def nonlinear_response(levels: int, gamma: float, wiggle: float, highest: float) -> PhaseResponse:
    """highest (x^gamma + wiggle sin 2 pi x), at x from 0 to 1 over the grey levels.

    highest: share of the panel's highest phase at the last level. Raises ValueError for a phase
    that falls from one level to the next.
    """
    x = np.linspace(0, 1, levels)
    return PhaseResponse.from_curve(
        _WAVELENGTH, highest * (x**gamma + wiggle * np.sin(2 * np.pi * x))
    )


def flatness_map(panel: Panel, terms: Iterable[tuple[int, int, float]]) -> PanelMap:
    """A panel's flatness: Zernike polynomials (n, m, metres rms) over the circle around it."""
    reach = 0.5 * panel.pitch * math.hypot(*panel.shape)
    y, x = (position / reach for position in panel.plane.mesh())
    path = torch.zeros(panel.shape, dtype=torch.float64)
    for n, m, strength in terms:
        path = path + strength * zernike(n, m, y, x)
    return PanelMap(path)


def illumination_map(panel: Panel, radius: float, centre: tuple[float, float]) -> PanelMap:
    """A Gaussian beam on a panel: radius to 1/e² and centre (y, x), in metres."""
    y, x = panel.plane.mesh()
    away = (y - centre[0]) ** 2 + (x - centre[1]) ** 2
    return PanelMap(torch.exp(-2 * away / radius**2))
