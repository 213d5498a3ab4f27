"""The PSF of a clear, thin lens by its Hankel integral (thesis Eq. 3.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import j0, roots_legendre

from optics.camera import Lens

Picture = NDArray[np.float64]


def round_lens_psf(
    lens: Lens, distance: float, wavelength: float, pitch: float, side: int
) -> Picture:
    """Return the shares of light on a square window: density at a pixel's centre times its area.

    The Hankel integral at a pixel's radius has three Gauss-Legendre nodes or more for two radians.
    """
    outer, scale = lens.stop_diameter / 2, wavelength * lens.image_distance
    vergence = 1 / distance - 1 / lens.focus_distance
    turn = 2 * np.pi * outer * (abs(vergence) * outer / wavelength + side * pitch / scale)
    panels = int(np.ceil(turn / 250))
    points, weights = roots_legendre(400)
    t = (np.arange(panels)[:, None] + (points + 1) / 2).ravel() / panels
    r, step = outer * t, outer * np.tile(weights, panels) / 2 / panels
    wave = 2 * np.pi * step * r * np.exp(1j * np.pi / wavelength * vergence * r**2)
    y = (np.arange(side) - side // 2) * pitch
    radii, place = np.unique(np.hypot(y[:, None], y[None, :]).ravel(), return_inverse=True)
    parts = np.array_split(radii, max(1, radii.size // 500))
    field = np.concatenate([j0(2 * np.pi / scale * np.outer(s, r)) @ wave for s in parts])
    density = np.abs(field) ** 2 / scale**2 / (np.pi * outer**2)
    return (density * pitch**2)[place].reshape(side, side)
