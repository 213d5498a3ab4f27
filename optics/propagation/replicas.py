"""When a plain sum over samples is the integral over a smooth field.

A sum over samples that are a pitch p apart carries copies of the field's spectrum, m / p away
from it. It is exact as far as no copy's light lands on the target, whatever else it does: the
copies needn't be filtered, only missed.

Light of frequencies from b to c goes to where its rays go, and a little beyond. To see how
little, give it a step down from 1 to 0 beyond c, of width sigma, in the gap where there is no
light: nothing changes. A ray f_s then meets, with kappa = dX/df,

    |integral of step(f) exp(-i pi kappa (f - f_s)²)| ~ exp(-2 pi² kappa² sigma² delta² /
                                                             (1 + 4 pi² kappa² sigma⁴))

of the kernel at a distance delta from the step's centre. That is least at sigma² = 1 / (2 pi
kappa), where it is exp(-pi kappa delta² / 2), if the gap has room for such a step.
"""

from __future__ import annotations

import math

from optics.propagation.span import FreeSpaceSpan

Interval = tuple[float, float]

_RAYS = 1.0
"""Wavelengths, for each e-fold of accuracy, from which on light is told from its rays."""


def step_widths(kappa: float, room: float, epsilon: float) -> tuple[float, float]:
    """Of a smooth step: from its centre to where it is over, and to where it lets nothing by.

    kappa: dX/df, square metres. room: cycles per metre between the step's centre and where
    it must be over. epsilon: what is nothing. Infinite without room.
    """
    log = math.log(1 / epsilon)
    if not room > 0:
        return math.inf, math.inf
    sigma = min(1 / math.sqrt(2 * math.pi * kappa), room / math.sqrt(2 * log))
    spread = math.sqrt(log * (1 + (2 * math.pi * kappa * sigma**2) ** 2) / 2)
    return sigma * math.sqrt(2 * log), spread / (math.pi * kappa * sigma)


def diffraction_margin(kappa: float, band: Interval, pitch: float, epsilon: float) -> float:
    """Cycles per metre beyond a band from which on rays have none of its light.

    pitch: metres; copies of the band stand 1 / pitch apart.
    """
    return sum(step_widths(kappa, (1 / pitch - (band[1] - band[0])) / 2, epsilon))


def replicas_miss_target(
    band: Interval, pitch: float, reach: Interval, kappa: float, epsilon: float
) -> bool:
    """Whether no copy of a band of frequencies is among the rays that reach the target."""
    margin = diffraction_margin(kappa, band, pitch, epsilon)
    if not math.isfinite(margin):
        return False
    first = math.floor((reach[0] - margin - band[1]) * pitch) + 1
    last = math.ceil((reach[1] + margin - band[0]) * pitch) - 1
    return first > last or (first >= 0 and last <= 0)


def field_band(span: FreeSpaceSpan, axis: int) -> Interval:
    """The least and the largest frequency of a smooth field."""
    return span.carrier[axis] - span.half_bandwidths[axis], span.carrier[
        axis
    ] + span.half_bandwidths[axis]


def target_ray_frequencies(span: FreeSpaceSpan, axis: int) -> Interval:
    """The frequencies of rays from the source to the target along axis 0 (y) or 1 (x)."""
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
    """Of the ray that goes `way` along one axis, `side` along the other, and `depth`."""
    if paraxial:
        return way / (wavelength * depth)
    return way / (wavelength * math.hypot(way, side, depth))


def oversampling_factor(span: FreeSpaceSpan, axis: int, epsilon: float, most: int) -> int:
    """How many times as many samples an axis needs for a plain sum; 0 if more than `most`.

    Frequencies beyond one over the wavelength die: copies there are missed as well.
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
            # Nothing dies there.
            if missed:
                return factor
            continue
        # A few wavelengths away rays say little: there the copies must have died.
        nearest = 1 / fine - max(map(abs, band))
        if missed and near > _RAYS * n.wavelength * math.log(1 / epsilon):
            return factor
        if nearest > 0 and _evanescent_decay(nearest, n.wavelength, near) < epsilon:
            return factor
    return 0


def _evanescent_decay(frequency: float, wavelength: float, distance: float) -> float:
    """What an evanescent wave has left; 1 for a wave that travels."""
    square = frequency**2 - 1 / wavelength**2
    return math.exp(-2 * math.pi * distance * math.sqrt(square)) if square > 0 else 1.0
