"""Aberrations of a lens, described over a disc beside its axis."""

from __future__ import annotations

from collections.abc import Iterable

import torch

from optics.validation import as_number
from optics.zernike import zernike

ZernikeTerms = tuple[tuple[int, int, float], ...]

_NEGLIGIBLE = 1e-12
"""Coefficients below this share of the strongest one are rounding errors. Chosen."""


def shift_aberrations(
    terms: Iterable[tuple[int, int, float]], y: float, x: float, radius: float = 1.0
) -> ZernikeTerms:
    """Return a lens' Zernike coefficients over a disc whose middle (y, x) lies beside the axis.

    Lengths are in stop radii; `radius` is that of the disc. A polynomial over another disc is a sum
    of polynomials of its degree and lower ones. The sum is found by solving at as many points as
    determine it. Its mean, which has no effect, is left out.
    """
    terms = tuple((n, m, as_number(path)) for n, m, path in terms)
    if not terms or ((y, x) == (0.0, 0.0) and radius == 1):
        return terms
    degree = max(n for n, _, _ in terms)
    names = [(n, m) for n in range(degree + 1) for m in range(-n, n + 1, 2)]
    # On so many even places along each axis, only the zero polynomial of this degree vanishes.
    places = torch.linspace(-1, 1, degree + 1, dtype=torch.float64)
    v, u = (one.reshape(-1) for one in torch.meshgrid(places, places, indexing="ij"))
    path = sum(strength * zernike(n, m, radius * v + y, radius * u + x) for n, m, strength in terms)
    assert isinstance(path, torch.Tensor)
    basis = torch.stack([zernike(n, m, v, u) for n, m in names], dim=1)
    found = torch.linalg.lstsq(basis, path[:, None]).solution[:, 0].tolist()
    least = _NEGLIGIBLE * max(abs(one) for one in found)
    return tuple(
        (n, m, one) for (n, m), one in zip(names, found, strict=True) if n and abs(one) > least
    )
