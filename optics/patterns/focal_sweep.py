"""An axicon whose depth in focus sweeps to and fro over a range."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import torch

from optics.camera import Panel
from optics.patterns.foci import (
    corner_radius,
    require_depth_range,
    require_lengths,
    require_slope_within,
    visible_share,
)
from optics.quarter_symmetry import mirror_quarter, quarter_distances

__all__ = ["focal_sweep_axicon"]

# Radii at which a focal sweep's phase is integrated, from the centre to the panel's corners.
#
# Between them it is linear. On the thesis' panel, with six sweeps over 2 dioptres at 520 nm, it
# is within 1e-6 rad of the integral.
_RADII = 200_001


def focal_sweep_axicon(
    panel: Panel,
    near: float,
    far: float,
    wavelength: float,
    sweeps: int = 6,
    focus: float = 0.0,
    radius: float | None = None,
    even_in: Literal["radius", "area"] = "radius",
) -> torch.Tensor:
    """Compute an axicon whose depth in focus sweeps to and fro between near and far.

    The panel's centre is in focus at `near`; outwards the depth goes to `far`, back to `near`, and
    so on, `sweeps` times. The phase is the integral of -2 pi / wavelength (V(r) - focus) r, and has
    no jumps.

    V, in dioptres, is linear either in r, or in the panel's area within r, which gives every depth
    the same light. The contrast at a spatial frequency comes from the places where V is the
    object's vergence, in the two directions across the frequency. By stationary phase it is the sum
    of wavelength over s times the modulus of V'(r), over these places, relative to the pupil's
    area, where s is the frequency as a distance in the pupil. With V linear in r it is therefore
    the same for all depths, and has the same sign, as one filter for all depths needs. (Places
    along the frequency, where V + r V' is the object's vergence, add a ripple over depth.) With one
    sweep, a direction in which the panel is short doesn't reach `far`, which then lacks contrast at
    the frequencies across that direction; more sweeps mend this.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    near, far : float
        Limits of the range in focus, dioptres; 0 is infinity. near is more than far.
    wavelength : float
        Metres.
    sweeps : int, default 6
        How often the depth crosses the range, 1 or more.
    focus : float, default 0.0
        Vergence of the plane in focus of the camera's lens, dioptres.
    radius : float, optional
        Where the last sweep ends, metres; by default the panel's corners. Beyond it the depth in
        focus stays.
    even_in : {"radius", "area"}, default "radius"
        Whether the depth grows evenly with the radius or with the panel's area.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians. It equals its mirror images in both axes bit for bit; its centre is that
        of the pixels.

    Raises
    ------
    ValueError
        If a number is out of range, or the pattern is too steep; the message names the limit.

    Notes
    -----
    Measured for the thesis' camera, 2 dioptres to infinity, as the expected error of one Wiener
    filter for 30 depths, with noise of 0.008 and the spectrum of Kodak's photographs, in dB: 18.0
    for one sweep, 20.9 to 21.0 for 5 to 10, 20.8 for 14; even in area 18.3 for one and 20.7 for 6.
    The ends of the range are its weakest depths: with 0.15 dioptres more at both, six photographs
    at the thesis' ten distances gain 2.0 dB at the worst and 0.4 dB in the mean.

    One sweep, even in the area of a circle, is the quartic axicon. `logarithmic_asphere` is its
    counterpart with the *distance* even in the area: every metre then gets the same light, and
    infinity can't be in the range.

    References
    ----------
    J. Sochacki, A. Kołodziejczyk, Z. Jaroszewicz and S. Bará, Appl. Opt. 31, 5326, 1992,
    doi 10.1364/AO.31.005326 (axicons with a given light along the axis); Opt. Express 19, 8693,
    2011 (logarithmic and quartic axicons compared).
    """
    require_depth_range(near, far)
    radius = require_lengths(panel, wavelength, focus, radius)
    most = max(1, math.floor(radius / (2 * panel.pitch)))
    if not 1 <= sweeps <= most:
        raise ValueError(f"sweeps is {sweeps}; choose 1 to {most}, two pixels each at least")
    r = torch.linspace(0, corner_radius(panel), _RADII, dtype=torch.float64)
    if even_in == "radius":
        share = torch.clamp(r / radius, max=1.0)
    elif even_in == "area":
        share = visible_share(panel, r**2, radius)
    else:
        raise ValueError(f"even_in is {even_in!r}; choose 'radius' or 'area'")
    # From 0 over 1 back to 0, and so on: how far the vergence is from near to far.
    progress = 1 - torch.abs(1 - torch.remainder(sweeps * share, 2))
    path = torch.cumulative_trapezoid((near - (near - far) * progress - focus) * 2 * r, r)
    path = torch.cat([torch.zeros(1, dtype=torch.float64), path])
    y, x = quarter_distances(panel.shape, (panel.pitch, panel.pitch))
    along = np.interp(torch.hypot(y, x).numpy(), r.numpy(), path.numpy())
    phase = -math.pi / wavelength * torch.from_numpy(along)
    require_slope_within(phase, None, f"near {near:g} or far {far:g}", panel, wavelength, focus)
    return mirror_quarter(phase, panel.shape)
