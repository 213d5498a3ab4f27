"""Zernike polynomials on the panel: to make aberrations, or to undo a lens' own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.camera import Panel
from optics.chebyshev import ChebyshevExpansion
from optics.patterns.slope import scale_within_slope
from optics.validation import require_positive, rounded_down
from optics.zernike import require_zernike_indices, zernike

__all__ = ["zernike_pattern"]


def zernike_pattern(
    panel: Panel,
    terms: Sequence[tuple[int, int, float]],
    radius: float,
    wavelength: float,
) -> torch.Tensor:
    """The sum of Zernike polynomials over a disc, as a lens with these aberrations adds it.

    terms: triples (n, m, metres of optical path, root mean square over the disc), as a Lens has
    them; negative ones undo a lens' own. radius: of the disc, metres on the panel. Beyond the
    disc the polynomials go on, and grow: the slope is judged on the whole panel. Raises
    ValueError for a polynomial that doesn't exist, and with the share of the terms that the
    pixels allow.
    """
    require_positive("radius", radius, "m")
    require_positive("wavelength", wavelength, "m")
    for n, m, strength in terms:
        require_zernike_indices(n, m)
        if not math.isfinite(strength):
            raise ValueError(f"the aberration ({n}, {m}) is {strength} m; it must be finite")
    path = _path(panel, terms, radius)
    if not torch.isfinite(path).all():
        raise ValueError(f"radius is {radius:g} m; the polynomials overflow: choose a larger one")
    return scale_within_slope(
        "terms",
        2 * math.pi / wavelength * path,
        1.0,
        lambda share: f"make them weaker, all by {rounded_down(share)}, or the radius larger",
    )


def _path(panel: Panel, terms: Sequence[tuple[int, int, float]], radius: float) -> torch.Tensor:
    """Metres on every pixel, (rows, columns)."""

    def path(y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        parts = [strength * zernike(n, m, y / radius, x / radius) for n, m, strength in terms]
        return torch.stack(parts).sum(dim=0) if parts else 0 * y * x

    degree = max((n for n, _, _ in terms), default=0)
    return ChebyshevExpansion(path, panel.plane, degree + 1).rows(slice(None))
