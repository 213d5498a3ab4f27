"""Decide whether a sum over samples equals the propagation integral of a smooth field.

A sum over samples with pitch p contains replicas of the field's spectrum, displaced by m / p. The
sum is exact on the target if no replica's light reaches it. The replicas needn't be filtered out;
they only have to miss the target.

Light of frequencies from b to c reaches the points that its rays reach, and a margin beyond. The
margin follows from a step from 1 to 0 beyond c, of width sigma, in the gap without light, where the
step changes nothing. A ray f_s then gets, with kappa = dX/df,

    |integral of step(f) exp(-i pi kappa (f - f_s)²)| ~ exp(-2 pi² kappa² sigma² delta² /
                                                             (1 + 4 pi² kappa² sigma⁴))

of the kernel at a distance delta from the step's centre. That is least at sigma² = 1 / (2 pi
kappa), where it is exp(-pi kappa delta² / 2), if the gap is wide enough for such a step.
"""

from __future__ import annotations

import math

from optics.propagation.span import FreeSpaceSpan

Interval = tuple[float, float]


def step_widths(kappa: float, room: float, epsilon: float) -> tuple[float, float]:
    """Return two widths of a smooth step in a propagated field's spectrum, cycles per metre.

    The first is the distance from the step's centre to its end, the second to where it passes no
    light. kappa: dX/df, square metres. room: cycles per metre between the step's centre and the
    frequency by which it must end. epsilon: the share of the light that counts as zero. Both widths
    are infinite if `room` isn't positive.
    """
    log = math.log(1 / epsilon)
    if not room > 0:
        return math.inf, math.inf
    sigma = min(1 / math.sqrt(2 * math.pi * kappa), room / math.sqrt(2 * log))
    spread = math.sqrt(log * (1 + (2 * math.pi * kappa * sigma**2) ** 2) / 2)
    return sigma * math.sqrt(2 * log), spread / (math.pi * kappa * sigma)


def diffraction_margin(kappa: float, band: Interval, pitch: float, epsilon: float) -> float:
    """Return the margin beyond a propagation band outside which rays carry no light of it.

    The margin is in cycles per metre. pitch: metres; replicas of the band are 1 / pitch apart.
    """
    return sum(step_widths(kappa, (1 / pitch - (band[1] - band[0])) / 2, epsilon))


def replicas_miss_target(
    band: Interval, pitch: float, reach: Interval, kappa: float, epsilon: float
) -> bool:
    """Return whether no replica of a propagation's band has rays that reach the target."""
    margin = diffraction_margin(kappa, band, pitch, epsilon)
    if not math.isfinite(margin):
        return False
    first = math.floor((reach[0] - margin - band[1]) * pitch) + 1
    last = math.ceil((reach[1] + margin - band[0]) * pitch) - 1
    return first > last or (first >= 0 and last <= 0)


def field_band(span: FreeSpaceSpan, axis: int) -> Interval:
    """Return the least and largest frequency of a propagation's smooth field along an axis."""
    return span.carrier[axis] - span.half_bandwidths[axis], span.carrier[
        axis
    ] + span.half_bandwidths[axis]


def target_ray_frequencies(span: FreeSpaceSpan, axis: int) -> Interval:
    """Return the least and largest frequency of rays that propagate from source to target.

    axis: 0 (y) or 1 (x).
    """
    n = span.numeric
    depths = [abs(corner[2]) for corner in span.target_corners]
    low, high = span.lateral_range(axis)
    across = max(map(abs, span.lateral_range(1 - axis)))
    rays = [
        _ray_frequency(n.wavelength, way, depth, side, span.paraxial)
        for way in (low, high)
        for depth in (min(depths), max(depths))
        for side in (0.0, across)
    ]
    return (min(rays), max(rays)) if n.distance > 0 else (-max(rays), -min(rays))


def _ray_frequency(
    wavelength: float, way: float, depth: float, side: float, paraxial: bool
) -> float:
    """Return the frequency along an axis of a propagated ray.

    way, side, depth: the ray's displacement along this axis, the other one and the optical axis.
    """
    if paraxial:
        return way / (wavelength * depth)
    return way / (wavelength * math.hypot(way, side, depth))


def oversampling_factor(span: FreeSpaceSpan, axis: int, epsilon: float, most: int) -> int:
    """Return the oversampling factor at which a smooth field can be propagated as a sum.

    The result is 0 if the factor would exceed `most`. Replicas at frequencies beyond 1 / wavelength
    are evanescent, so they may also decay before the target.
    """
    n = span.numeric
    band, reach, pitch = (
        field_band(span, axis),
        target_ray_frequencies(span, axis),
        n.source.pitch[axis],
    )
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
        nearest = 1 / fine - max(map(abs, band))
        if missed and near > n.wavelength * math.log(1 / epsilon):
            return factor
        if nearest > 0 and _evanescent_decay(nearest, n.wavelength, near) < epsilon:
            return factor
    return 0


def _evanescent_decay(frequency: float, wavelength: float, distance: float) -> float:
    """Return the amplitude that an evanescent wave keeps in free space, or 1 for other waves."""
    square = frequency**2 - 1 / wavelength**2
    return math.exp(-2 * math.pi * distance * math.sqrt(square)) if square > 0 else 1.0
