"""Decide for which spans Fresnel's integral is accurate enough, and bound its error."""

from __future__ import annotations

import math
from dataclasses import replace

from optics.accuracy import ToleranceError
from optics.propagation.propagator import Propagator
from optics.propagation.replicas import field_band, target_ray_frequencies
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.tolerance_shares import TOLERANCE_SHARES
from optics.propagation.transfer_function import paraxial_phase_error


def paraxial_model_error(span: FreeSpaceSpan, frequency: float) -> float:
    """Return the error of paraxial propagation for frequencies up to `frequency`, cycles/m.

    The error is 0 for a span whose declared model is paraxial. Raises ToleranceError where the
    paraxial phase error of a scalar wave exceeds its share of the tolerance.
    """
    n = span.numeric
    if n.paraxial:
        return 0.0
    error = paraxial_phase_error(n.wavelength, n.distance, frequency)
    if error > TOLERANCE_SHARES.model * n.tol:
        raise ToleranceError(
            f"tol {n.tol:g} can't be kept by a paraxial method, which is off by up to "
            f"{error:.2g} rad here; use the scalar methods, or ask for paraxial=True"
        )
    return error


class ParaxialPropagator(Propagator):
    """Base class of the methods that compute Fresnel's integral between parallel planes.

    They also replace the scalar model where their model error is small enough.
    """

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        self._require_parallel()
        self._paraxial_span = replace(span, paraxial=True)
        self._model_error = paraxial_model_error(
            span, _largest_kernel_frequency(self._paraxial_span)
        )

    @property
    def rounding_share(self) -> float:
        # An error of one sample spreads evenly over the target's plane.
        n = self._paraxial_span.numeric
        sides = n.source.pitch if n.cells is None else n.cells
        spread = zip(n.target.shape, n.target.pitch, sides, strict=True)
        return math.prod(min(m * pitch * side / abs(n.scale), 1.0) for m, pitch, side in spread)


def _largest_kernel_frequency(span: FreeSpaceSpan) -> float:
    """Return the largest frequency at which a Fresnel propagator's kernel phase matters, cycles/m.

    The next term of the phase, c f⁴, adds c times (D_y² + D_x²)² h to the kernel h, with
    D = d/dx / (2 pi i). On the chirp exp(i pi x² / scale), D² is f² + 1 / (2 pi i scale) and D⁴ is
    f⁴ + 6 f² / (2 pi i scale) - 3 / (2 pi scale)², where f = x / scale is the ray's frequency.
    That is no more than (f² + 3 / (2 pi scale))². For a smooth field, the frequency is limited by
    the field's own band.
    """
    blur = 3 / (2 * math.pi * abs(span.numeric.scale))
    axes = []
    for axis in (0, 1):
        rays = math.hypot(max(map(abs, target_ray_frequencies(span, axis))), math.sqrt(blur))
        axes.append(min(rays, max(map(abs, field_band(span, axis)))))
    return math.hypot(*axes)


def kernel_turns(span: FreeSpaceSpan) -> float:
    """Return the paraxial propagation kernel's phase between the two farthest points, in turns."""
    ways = (max(map(abs, span.lateral_range(axis))) for axis in (0, 1))
    return max(way**2 for way in ways) / (2 * abs(span.numeric.scale))
