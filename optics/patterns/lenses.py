"""Phases that focus light, the Fresnel lens and the axicon, and those of aberrations."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.camera import Panel
from optics.chebyshev import ChebyshevExpansion
from optics.patterns.slope import require_slope, scale_within_slope
from optics.validation import require_positive, require_wavelength, rounded_down, rounded_up
from optics.zernike import require_zernike_indices, zernike

__all__ = ["axicon", "fresnel_lens", "zernike_pattern"]


def fresnel_lens(
    panel: Panel,
    focal_length: float,
    wavelength: float,
    centre: tuple[float, float] = (0.0, 0.0),
) -> torch.Tensor:
    """Compute the phase of a thin lens, -pi r² / (wavelength f) (thesis Eq. 2.14).

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    focal_length : float
        Metres; positive for a converging lens. The shortest one that the pixels allow is
        pitch x side / wavelength for a lens in the middle of the panel.
    wavelength : float
        Metres.
    centre : tuple of (float, float), default (0.0, 0.0)
        (y, x) of the lens on the panel, metres. Away from the axis it also shifts the image.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If a length is invalid, or the phase is too steep; the message names the shortest focal
        length.

    Examples
    --------
    >>> from optics.camera import Panel
    >>> from optics.patterns import fresnel_lens
    >>> phase = fresnel_lens(Panel(), focal_length=2.0, wavelength=550e-9)
    >>> tuple(phase.shape)
    (1080, 1920)
    """
    if focal_length == 0 or not math.isfinite(focal_length) or not math.isfinite(1 / focal_length):
        raise ValueError(f"focal_length is {focal_length} m; it must be finite and not zero")
    require_wavelength("wavelength", wavelength)
    if not all(math.isfinite(c) for c in centre):
        raise ValueError(f"centre {centre} m must be finite in each axis")
    y, x = panel.plane.mesh()
    shape = -math.pi / wavelength * ((y - centre[0]) ** 2 + (x - centre[1]) ** 2)
    return scale_within_slope(
        "focal_length",
        shape,
        1 / focal_length,
        lambda power: f"choose at least {rounded_up(1 / power)} m in size",
    )


def axicon(panel: Panel, radius: float, distance: float, wavelength: float) -> torch.Tensor:
    """Compute an axicon, a cone of phase that images a point as a ring.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    radius : float
        Radius of the ring, metres on the sensor. With a negative radius the light first
        converges towards the axis.
    distance : float
        Metres from the lens to the sensor.
    wavelength : float
        Metres.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If a length is invalid, or the phase is too steep; the message names the largest radius.
    """
    require_positive("distance", distance, "m")
    require_wavelength("wavelength", wavelength)
    if not math.isfinite(radius):
        raise ValueError(f"radius is {radius:g} m; it must be finite")
    slope = 2 * math.pi * radius / (wavelength * distance)
    largest = wavelength * distance / (2 * panel.pitch)
    remedy = f"choose at most {rounded_down(largest)} m in size"
    require_slope("radius", abs(slope) * panel.pitch, remedy)
    y, x = panel.plane.mesh()
    return slope * torch.hypot(y, x)


def zernike_pattern(
    panel: Panel,
    terms: Sequence[tuple[int, int, float]],
    radius: float,
    wavelength: float,
) -> torch.Tensor:
    """Compute a sum of Zernike polynomials as a phase, like the aberrations of a lens.

    The polynomials also grow beyond their disc, and the slope is checked on the whole panel.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    terms : sequence of (int, int, float)
        Triples (n, m, optical path in metres, root mean square over the disc), as in
        `Lens.aberrations`. Terms with the opposite sign correct those of a lens.
    radius : float
        Radius of the disc, metres on the panel.
    wavelength : float
        Metres.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If a polynomial doesn't exist, a number isn't finite or positive, or the phase is too steep;
        the message names the share of the terms.

    Examples
    --------
    >>> from optics.camera import Panel
    >>> from optics.patterns import zernike_pattern
    >>> phase = zernike_pattern(Panel(), [(2, 0, 100e-9)], radius=4e-3, wavelength=550e-9)
    >>> tuple(phase.shape)
    (1080, 1920)
    """
    require_positive("radius", radius, "m")
    require_wavelength("wavelength", wavelength)
    for n, m, strength in terms:
        require_zernike_indices(n, m)
        if not math.isfinite(strength):
            raise ValueError(f"the aberration ({n}, {m}) is {strength} m; it must be finite")

    def optical_path(y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        parts = [strength * zernike(n, m, y / radius, x / radius) for n, m, strength in terms]
        return torch.stack(parts).sum(dim=0) if parts else 0 * y * x

    degree = max((n for n, _, _ in terms), default=0)
    path = ChebyshevExpansion(optical_path, panel.plane, degree + 1).rows(slice(None))
    if not torch.isfinite(path).all():
        raise ValueError(f"radius is {radius:g} m; the polynomials overflow: choose a larger one")
    return scale_within_slope(
        "terms",
        2 * math.pi / wavelength * path,
        1.0,
        lambda share: f"make them weaker, all by {rounded_down(share)}, or the radius larger",
    )
