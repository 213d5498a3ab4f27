"""Decide for which spans Fresnel's integral, and a sum over samples, are accurate enough."""

from __future__ import annotations

import math
from dataclasses import replace

from optics.accuracy import ToleranceError
from optics.propagation.propagator import Propagator, Share
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.transfer_function import paraxial_phase_error

Interval = tuple[float, float]


def step_widths(kappa: float, room: float, epsilon: float) -> tuple[float, float]:
    """Return how far a smooth step in a field's spectrum reaches, in cycles per metre.

    The first width goes from the step's centre to its end, the second to where it passes no light.
    kappa: dX/df, square metres. room: from the centre to the frequency by which the step must end;
    both widths are infinite if it isn't positive. epsilon: the share of light that counts as zero.
    """
    log = math.log(1 / epsilon)
    if not room > 0:
        return math.inf, math.inf
    sigma = min(1 / math.sqrt(2 * math.pi * kappa), room / math.sqrt(2 * log))
    spread = math.sqrt(log * (1 + (2 * math.pi * kappa * sigma**2) ** 2) / 2)
    return sigma * math.sqrt(2 * log), spread / (math.pi * kappa * sigma)


def diffraction_margin(kappa: float, band: Interval, pitch: float, epsilon: float) -> float:
    """Return the margin beyond a band outside which rays carry none of its light, cycles/m.

    pitch: metres; replicas of the band are 1 / pitch apart.
    """
    return sum(step_widths(kappa, (1 / pitch - (band[1] - band[0])) / 2, epsilon))


def replicas_miss_target(
    band: Interval, pitch: float, reach: Interval, kappa: float, epsilon: float
) -> bool:
    """Return whether no replica of a band has rays that reach the target."""
    margin = diffraction_margin(kappa, band, pitch, epsilon)
    if not math.isfinite(margin):
        return False
    first = math.floor((reach[0] - margin - band[1]) * pitch) + 1
    last = math.ceil((reach[1] + margin - band[0]) * pitch) - 1
    return first > last or (first >= 0 and last <= 0)


def target_ray_frequencies(span: FreeSpaceSpan, axis: int) -> Interval:
    """Return the least and largest frequency of rays from source to target along an axis."""
    n = span.numeric
    depths = [abs(corner[2]) for corner in span.target_corners]
    low, high = span.lateral_range(axis)
    across = max(map(abs, span.lateral_range(1 - axis)))
    rays = []
    for way in (low, high):
        for depth in (min(depths), max(depths)):
            for side in (0.0, across):
                length = depth if span.paraxial else math.hypot(way, side, depth)
                rays.append(way / (n.wavelength * length))
    return (min(rays), max(rays)) if n.distance > 0 else (-max(rays), -min(rays))


def oversampling_factor(span: FreeSpaceSpan, axis: int, epsilon: float, most: int) -> int:
    """Return the oversampling factor at which a smooth field may be summed over its samples.

    It is 0 if the factor would exceed `most`. Replicas at frequencies beyond 1 / wavelength are
    evanescent, so they may also decay before the target.
    """
    n = span.numeric
    band, reach = span.field_band(axis), target_ray_frequencies(span, axis)
    pitch = n.source.pitch[axis]
    near = min(abs(corner[2]) for corner in span.target_corners)
    kappa = n.wavelength * near
    for factor in range(1, most + 1):
        fine = pitch / factor
        missed = replicas_miss_target(band, fine, reach, kappa, epsilon)
        if span.paraxial:
            # There are no evanescent waves in the paraxial model.
            if missed:
                return factor
            continue
        # Rays describe the light only from a distance on of one wavelength for each e-fold of
        # accuracy. At shorter distances, the replicas must have decayed.
        if missed and near > n.wavelength * math.log(1 / epsilon):
            return factor
        nearest = 1 / fine - max(map(abs, band))
        square = nearest**2 - 1 / n.wavelength**2
        if (
            nearest > 0
            and square > 0
            and math.exp(-2 * math.pi * near * math.sqrt(square)) < epsilon
        ):
            return factor
    return 0


def paraxial_model_error(span: FreeSpaceSpan, frequency: float) -> float:
    """Return the error of the paraxial model up to a frequency in cycles/m; 0 if it is declared.

    Raises ToleranceError where the phase error exceeds its share of the tolerance.
    """
    n = span.numeric
    if n.paraxial:
        return 0.0
    error = paraxial_phase_error(n.wavelength, n.distance, frequency)
    if error > Share.MODEL * n.tol:
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
        # An error of one sample spreads evenly over the target's plane.
        n = self._paraxial_span.numeric
        sides = n.source.pitch if n.cells is None else n.cells
        for axis in (0, 1):
            width = n.target.shape[axis] * n.target.pitch[axis]
            self.rounding_share *= min(width * sides[axis] / abs(n.scale), 1.0)


def _largest_kernel_frequency(span: FreeSpaceSpan) -> float:
    """Return the largest frequency at which a Fresnel kernel's phase matters, cycles/m.

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
        axes.append(min(rays, max(map(abs, span.field_band(axis)))))
    return math.hypot(*axes)
