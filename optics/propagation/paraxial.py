"""Which questions Fresnel's integral answers, and how well."""

from __future__ import annotations

import math
from dataclasses import replace

from optics.accuracy import ToleranceError
from optics.propagation.replicas import field_band, reaching
from optics.propagation.span import Span
from optics.propagation.spectral import MODEL_SHARE
from optics.propagation.transfer import paraxial_error


def as_paraxial(name: str, span: Span) -> tuple[Span, float]:
    """The span in the paraxial model, and what that leaves out of a scalar wave: 0 where the
    paraxial model is the one declared.

    Raises ValueError for planes that aren't parallel, ToleranceError where a scalar wave is
    asked for and the paraxial phase is off by more than a part of the tolerance.
    """
    if any(span.tilt):
        raise ValueError(
            f"tilt is {span.tilt} rad; {name} needs parallel planes: use the tilted angular "
            "spectrum or direct quadrature"
        )
    if span.paraxial:
        return span, 0.0
    paraxial = replace(span, paraxial=True)
    n = span.numeric
    error = paraxial_error(n.wavelength, n.distance, _farthest(paraxial))
    if error > MODEL_SHARE * n.tol:
        raise ToleranceError(
            f"tol {n.tol:g} can't be kept by a paraxial method, which is off by up to "
            f"{error:.2g} rad here; use the scalar methods, or ask for paraxial=True"
        )
    return paraxial, error


def _farthest(span: Span) -> float:
    """The largest frequency at which a kernel's phase counts, cycles per metre.

    The next term of the phase, c f⁴, adds c times (D_y² + D_x²)² h to the kernel h, with
    D = d/dx / (2 pi i). On the chirp exp(i pi x² / scale), D² is f² + 1 / (2 pi i scale) and D⁴
    f⁴ + 6 f² / (2 pi i scale) - 3 / (2 pi scale)², where f = x / scale is the ray's frequency:
    no more than (f² + 3 / (2 pi scale))². A smooth field has no more than its own fringes.
    """
    blur = 3 / (2 * math.pi * abs(span.numeric.scale))
    axes = []
    for axis in (0, 1):
        rays = math.hypot(max(map(abs, reaching(span, axis))), math.sqrt(blur))
        axes.append(min(rays, max(map(abs, field_band(span, axis)))))
    return math.hypot(*axes)


def kernel_turns(span: Span) -> float:
    """Turns of the paraxial kernel between the points that are farthest from each other."""
    ways = (max(map(abs, span.lateral(axis))) for axis in (0, 1))
    return max(way**2 for way in ways) / (2 * abs(span.numeric.scale))
