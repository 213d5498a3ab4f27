"""Which requests Fresnel's integral answers, and how well."""

from __future__ import annotations

import math
from dataclasses import replace

from optics.accuracy import ToleranceError
from optics.propagation.propagator import Propagator
from optics.propagation.replicas import field_band, target_ray_frequencies
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.transfer_function import paraxial_phase_error

MODEL_SHARE = 0.3
"""Of the tolerance, that a paraxial method may leave out of a scalar wave."""


def paraxial_model_error(span: FreeSpaceSpan, frequency: float) -> float:
    """What the paraxial model leaves out up to a frequency: 0 where it is the one declared.

    Raises ToleranceError where the paraxial phase of a scalar wave is off by more than a part of
    the tolerance.
    """
    n = span.numeric
    if n.paraxial:
        return 0.0
    error = paraxial_phase_error(n.wavelength, n.distance, frequency)
    if error > MODEL_SHARE * n.tol:
        raise ToleranceError(
            f"tol {n.tol:g} can't be kept by a paraxial method, which is off by up to "
            f"{error:.2g} rad here; use the scalar methods, or ask for paraxial=True"
        )
    return error


class ParaxialPropagator(Propagator):
    """A way to compute Fresnel's integral between parallel planes, in place of a scalar wave's
    where that is as good."""

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        self._require_parallel()
        self._paraxial_span = replace(span, paraxial=True)
        self._model_error = paraxial_model_error(
            span, _largest_kernel_frequency(self._paraxial_span)
        )


def _largest_kernel_frequency(span: FreeSpaceSpan) -> float:
    """The largest frequency at which a kernel's phase counts, cycles per metre.

    The next term of the phase, c f⁴, adds c times (D_y² + D_x²)² h to the kernel h, with
    D = d/dx / (2 pi i). On the chirp exp(i pi x² / scale), D² is f² + 1 / (2 pi i scale) and D⁴
    f⁴ + 6 f² / (2 pi i scale) - 3 / (2 pi scale)², where f = x / scale is the ray's frequency:
    no more than (f² + 3 / (2 pi scale))². A smooth field has no more than its own fringes.
    """
    blur = 3 / (2 * math.pi * abs(span.numeric.scale))
    axes = []
    for axis in (0, 1):
        rays = math.hypot(max(map(abs, target_ray_frequencies(span, axis))), math.sqrt(blur))
        axes.append(min(rays, max(map(abs, field_band(span, axis)))))
    return math.hypot(*axes)


def kernel_turns(span: FreeSpaceSpan) -> float:
    """Turns of the paraxial kernel between the points that are farthest from each other."""
    ways = (max(map(abs, span.lateral_range(axis))) for axis in (0, 1))
    return max(way**2 for way in ways) / (2 * abs(span.numeric.scale))
