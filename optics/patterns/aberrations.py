"""Phases of Zernike polynomials, which make aberrations or correct those of a lens."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.camera import Panel
from optics.chebyshev import ChebyshevExpansion
from optics.patterns.slope import scale_within_slope
from optics.validation import require_positive, require_wavelength, rounded_down
from optics.zernike import require_zernike_indices, zernike

__all__ = ["zernike_pattern"]


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
        If a polynomial doesn't exist, a number isn't finite or positive, or the pattern is too
        steep for the pixels; the message then names the share of the terms that they allow.

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
    path = _zernike_path(panel, terms, radius)
    if not torch.isfinite(path).all():
        raise ValueError(f"radius is {radius:g} m; the polynomials overflow: choose a larger one")
    return scale_within_slope(
        "terms",
        2 * math.pi / wavelength * path,
        1.0,
        lambda share: f"make them weaker, all by {rounded_down(share)}, or the radius larger",
    )


def _zernike_path(
    panel: Panel, terms: Sequence[tuple[int, int, float]], radius: float
) -> torch.Tensor:
    """Compute the optical path at the panel's pixels, metres, (rows, columns)."""

    def path(y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        parts = [strength * zernike(n, m, y / radius, x / radius) for n, m, strength in terms]
        return torch.stack(parts).sum(dim=0) if parts else 0 * y * x

    degree = max((n for n, _, _ in terms), default=0)
    return ChebyshevExpansion(path, panel.plane, degree + 1).rows(slice(None))
