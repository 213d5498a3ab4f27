"""Choose the band of spatial frequencies of a propagation, and its sampling.

A ray of frequency f is displaced sideways by X(f)
(optics.propagation.transfer_function.PlaneWaveRays). Only rays from the source to the target
matter. The other frequencies are cut off for a reason: a spectrum that is sampled every df makes
replicas of the source every 1 / df, and with fewer rays the replicas may be closer together.

A sharp cut would cause ringing. With a cut by a Gaussian-smoothed step of width sigma at f_c, the
light that is removed from a ray f_s = f_c - delta is, with kappa = dX/df,

    |integral of step(f) exp(-i pi kappa (f - f_s)²)| ~ exp(-2 pi² kappa² sigma² delta² /
                                                             (1 + 4 pi² kappa² sigma⁴)),

By symmetry, the same expression gives the light that passes at rays f_c + delta. Both are least at
sigma² = 1 / (2 pi kappa), where they are exp(-L), L = pi kappa delta² / 2. Where kappa is larger
beyond the edge, as it is for steeper rays, they are smaller. The factor before the exponential is
about 1 / (2 pi kappa delta). Summed over all points of the source, whose rays are delta or more
from the edge (Schur's test), an edge costs at most exp(-L) / (4 pi L) of the source's light. There
are four edges and a circle, each for light that is removed and for light from replicas. The samples
end where the step has fallen to a twentieth of epsilon. (Matsushima and Shimobaba 2009,
10.1364/OE.17.019662, cut sharply at the last ray that the period holds.)
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import torch

from optics.accuracy import ToleranceError
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.transfer_function import PlaneWaveRays


@functools.lru_cache(maxsize=64)
def edge_exponent(epsilon: float) -> float:
    """Return the exponent L at which the edges of a frequency band together cost `epsilon`.

    It is 1 at least, because the estimate holds from there on.
    """
    # Four edges and a circle count twice: for light that is removed, and for light from replicas.
    edges = 10
    exponent = 1.0
    for _ in range(20):
        exponent = max(math.log(edges / (4 * math.pi * exponent * epsilon)), 1.0)
    return exponent


@dataclass(frozen=True)
class FrequencyTaper:
    """A smooth low-pass step in spatial frequency, whose width suits the slope of the rays.

    last_full_frequency: the highest frequency that must pass without loss, cycles per metre.
    ray_slope: the least dX/df there and beyond, square metres.
    epsilon: the share of the light that may be lost.
    """

    last_full_frequency: float
    ray_slope: float
    epsilon: float

    @property
    def delta(self) -> float:
        return math.sqrt(2 * edge_exponent(self.epsilon) / (math.pi * self.ray_slope))

    @property
    def sigma(self) -> float:
        return 1 / math.sqrt(2 * math.pi * self.ray_slope)

    @property
    def centre(self) -> float:
        return self.last_full_frequency + self.delta

    @property
    def stop_frequency(self) -> float:
        """The frequency from which on no light passes."""
        return self.centre + self.delta

    @property
    def end(self) -> float:
        """The frequency at which the taper is down to a twentieth of epsilon.

        It follows from erfc(t) ~ exp(-t²) / (t sqrt(pi)).
        """
        return self.centre + math.sqrt(2 * math.log(2 / self.epsilon)) * self.sigma

    def __call__(self, frequency: torch.Tensor) -> torch.Tensor:
        return torch.erfc((frequency - self.centre) / (math.sqrt(2) * self.sigma)) / 2


@dataclass(frozen=True)
class AxisBand:
    """The spatial frequencies along one axis, cycles per metre.

    low, high: the range of the samples.
    passband: the range of the light that passes.
    below, above: the tapers at either end, if any; `below` is a taper in the negative frequency.
    """

    low: float
    high: float
    passband: tuple[float, float]
    below: FrequencyTaper | None = None
    above: FrequencyTaper | None = None

    @property
    def mirror_image(self) -> AxisBand:
        low, high = self.passband
        return AxisBand(-self.high, -self.low, (-high, -low), self.above, self.below)

    @property
    def largest_passed_frequency(self) -> float:
        """The largest frequency that passes along this axis."""
        return max(map(abs, self.passband))

    @property
    def largest_target_frequency(self) -> float:
        """The largest frequency along this axis of light that reaches the target."""
        low, high = self.passband
        if self.above:
            high = min(high, self.above.last_full_frequency)
        if self.below:
            low = max(low, -self.below.last_full_frequency)
        return max(abs(low), abs(high))

    def taper(self, frequency: torch.Tensor) -> torch.Tensor:
        value = torch.ones_like(frequency)
        if self.above:
            value = value * self.above(frequency)
        if self.below:
            value = value * self.below(-frequency)
        return value


@dataclass(frozen=True)
class FrequencyBand:
    """The spatial frequencies along (y, x), and the period of the source's replicas.

    axes: the bands along y and x.
    radial: a taper in the modulus of the frequency, for bands whose corners would contain grazing
        rays.
    period: least distance of the replicas along (y, x), metres; the frequencies are 1 / period
        apart, or closer.
    epsilon: share of the light that may be lost.
    """

    axes: tuple[AxisBand, AxisBand]
    radial: FrequencyTaper | None
    period: tuple[float, float]
    epsilon: float

    @property
    def largest_target_frequency(self) -> float:
        """The largest modulus of a frequency that reaches the target."""
        return math.hypot(*(axis.largest_target_frequency for axis in self.axes))

    @property
    def largest_frequency(self) -> float:
        """The largest modulus of a frequency in the band."""
        corner = math.hypot(*(axis.largest_passed_frequency for axis in self.axes))
        return min(corner, self.radial.stop_frequency) if self.radial else corner


def resolved_band(span: FreeSpaceSpan) -> FrequencyBand:
    """Return the band of all frequencies that a smooth field's samples resolve, without a taper.

    Raises ToleranceError if some rays of the field are grazing.
    """
    axes = []
    for carrier, band, pitch in zip(
        span.carrier, span.half_bandwidths, span.source.pitch, strict=True
    ):
        passes = (carrier - band, carrier + band)
        axes.append(AxisBand(carrier - 0.5 / pitch, carrier + 0.5 / pitch, passes))
    return _with_period(span, (axes[0], axes[1]), None, 0.0)


def target_band(span: FreeSpaceSpan, epsilon: float) -> FrequencyBand:
    """Return the band of the frequencies whose rays reach the target, with smooth ends.

    epsilon: largest share of the source's light that may be lost or come from replicas.
    Raises ToleranceError if some rays to the target are grazing.
    """
    rays = _rays(span)
    tangents = [_target_tangents(span, axis) for axis in (0, 1)]
    near = min(abs(z) for _, _, z in span.numeric.target_corners)
    reach = _TargetBands(span, rays, near, epsilon)
    outer = [reach.axis_band(axis, tangents[axis], 0.0) for axis in (0, 1)]
    axes = [
        reach.axis_band(axis, tangents[axis], outer[1 - axis].largest_passed_frequency)
        for axis in (0, 1)
    ]
    farthest = rays.frequency(math.hypot(*(max(map(abs, t)) for t in tangents)))
    radial = reach.taper_above(farthest, outward=True)
    corner = math.hypot(*(axis.largest_passed_frequency for axis in axes))
    cuts = not rays.paraxial and radial.stop_frequency < corner
    return _with_period(span, (axes[0], axes[1]), radial if cuts else None, epsilon)


@dataclass(frozen=True)
class _TargetBands:
    """Compute, for each axis, the frequency band of the rays that reach the target."""

    span: FreeSpaceSpan
    rays: PlaneWaveRays
    near: float
    epsilon: float

    def taper_above(self, edge: float, outward: bool) -> FrequencyTaper:
        """Return the taper above a frequency, which suits the least slope of the rays beyond it."""
        slowest = min(max(edge, 0.0), 0.999999 * self.rays.grazing_frequency) if outward else 0.0
        return FrequencyTaper(edge, self.rays.ray_slope(slowest, self.near), self.epsilon)

    def axis_band(self, axis: int, tangents: tuple[float, float], across: float) -> AxisBand:
        """Return the frequency band along an axis, mirrored for backward propagation.

        across: largest frequency along the other axis.
        """
        low, high = tangents
        above = self._taper_beyond_tangent(high, across)
        below = self._taper_beyond_tangent(-low, across)
        backwards = self.span.numeric.distance < 0
        band = AxisBand(
            -below.end, above.end, (-below.stop_frequency, above.stop_frequency), below, above
        )
        return self._within_field_band(band.mirror_image if backwards else band, axis)

    def _taper_beyond_tangent(self, tangent: float, across: float) -> FrequencyTaper:
        """Return the taper beyond the frequency of rays with a given tangent.

        If the tangent isn't positive, an oblique wave reaches it with a frequency of smaller
        modulus.
        """
        if tangent > 0:
            return self.taper_above(self.rays.frequency(tangent), outward=True)
        return self.taper_above(self.rays.frequency(tangent, across), outward=False)

    def _within_field_band(self, band: AxisBand, axis: int) -> AxisBand:
        """Return the part of a band that lies in the field's own band."""
        span = self.span
        least = span.carrier[axis] - span.half_bandwidths[axis]
        most = span.carrier[axis] + span.half_bandwidths[axis]
        if band.low >= most or band.high <= least:
            raise ToleranceError(
                f"tol {span.tol:g} can't be kept: none of the field's light goes towards the "
                f"target in {'yx'[axis]}; move the target, or give the band= that the light has"
            )
        passes = (max(band.passband[0], least), min(band.passband[1], most))
        return replace(band, low=max(band.low, least), high=min(band.high, most), passband=passes)


def _rays(span: FreeSpaceSpan) -> PlaneWaveRays:
    return PlaneWaveRays(span.numeric.wavelength, span.paraxial)


def _target_tangents(span: FreeSpaceSpan, axis: int) -> tuple[float, float]:
    """Return the least and largest tangent of the rays from source to target."""
    low, high = span.source_extent(axis)
    places = [(corner[axis], abs(corner[2])) for corner in span.numeric.target_corners]
    return min((p - high) / z for p, z in places), max((p - low) / z for p, z in places)


def _with_period(
    span: FreeSpaceSpan,
    axes: tuple[AxisBand, AxisBand],
    radial: FrequencyTaper | None,
    epsilon: float,
) -> FrequencyBand:
    """Return a band with the least period at which no replica lights the target."""
    band = FrequencyBand(axes, radial, (math.inf, math.inf), epsilon)
    rays = _rays(span)
    if not band.largest_frequency < rays.grazing_frequency * (1 - 1e-9):
        n = span.numeric
        raise ToleranceError(
            f"tol {span.tol:g} can't be kept by a spectrum {n.distance:g} m away: rays to the "
            "target's edge graze the source. Use direct quadrature, a smaller target, a finer "
            "band= of a smooth field, or a larger distance"
        )
    period = (_period(span, band, rays, 0), _period(span, band, rays, 1))
    return replace(band, period=period)


def _period(span: FreeSpaceSpan, band: FrequencyBand, rays: PlaneWaveRays, axis: int) -> float:
    """Return the least period at which the source's replicas send no light to the target."""
    n = span.numeric
    low, high = band.axes[axis].passband
    if n.distance < 0:
        low, high = -high, -low
    left, right = (
        -_largest_tangent(band, rays, axis, -low),
        _largest_tangent(band, rays, axis, high),
    )
    first, last = span.source_extent(axis)
    ways = [0.0]
    for corner in n.target_corners:
        place, z = corner[axis], abs(corner[2])
        ways += [last + right * z - place, place - first - left * z]
    return max(ways)


def _largest_tangent(
    band: FrequencyBand, rays: PlaneWaveRays, axis: int, frequency: float
) -> float:
    """Return the largest tangent of a ray with the given frequency along an axis.

    Its frequency along the other axis is the largest that the band holds.
    """
    if frequency <= 0:
        return rays.tangent(frequency)
    left = math.sqrt(max(band.largest_frequency**2 - frequency**2, 0.0))
    return rays.tangent(frequency, min(band.axes[1 - axis].largest_passed_frequency, left))
