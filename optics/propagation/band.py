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


class FrequencyTaper:
    """A smooth low-pass step in spatial frequency, whose width suits the slope of the rays.

    last_full_frequency: the highest frequency that must pass without loss, cycles per metre.
    ray_slope: the least dX/df there and beyond, square metres.
    epsilon: the share of the light that may be lost.
    """

    def __init__(self, last_full_frequency: float, ray_slope: float, epsilon: float) -> None:
        delta = math.sqrt(2 * edge_exponent(epsilon) / (math.pi * ray_slope))
        self.last_full_frequency = last_full_frequency
        self._sigma = 1 / math.sqrt(2 * math.pi * ray_slope)
        self._centre = last_full_frequency + delta
        self.stop_frequency = self._centre + delta
        """The frequency from which on no light passes."""
        self.end = self._centre + math.sqrt(2 * math.log(2 / epsilon)) * self._sigma
        """The frequency at which the taper is down to a twentieth of epsilon.

        It follows from erfc(t) ~ exp(-t²) / (t sqrt(pi)).
        """

    def __call__(self, frequency: torch.Tensor) -> torch.Tensor:
        return torch.erfc((frequency - self._centre) / (math.sqrt(2) * self._sigma)) / 2


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
    def largest_passed_frequency(self) -> float:
        """The largest frequency that passes along this axis."""
        return max(map(abs, self.passband))

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
    epsilon: share of the light that may be lost.
    period: least distance of the replicas along (y, x), metres, at which none lights the target;
        the frequencies are 1 / period apart, or closer.
    """

    axes: tuple[AxisBand, AxisBand]
    radial: FrequencyTaper | None
    epsilon: float
    period: tuple[float, float] = (math.inf, math.inf)

    @property
    def largest_target_frequency(self) -> float:
        """The largest modulus of a frequency that reaches the target."""
        most = []
        for axis in self.axes:
            low, high = axis.passband
            if axis.above:
                high = min(high, axis.above.last_full_frequency)
            if axis.below:
                low = max(low, -axis.below.last_full_frequency)
            most.append(max(abs(low), abs(high)))
        return math.hypot(*most)

    @property
    def largest_frequency(self) -> float:
        """The largest modulus of a frequency in the band."""
        y, x = self.axes
        corner = math.hypot(y.largest_passed_frequency, x.largest_passed_frequency)
        return min(corner, self.radial.stop_frequency) if self.radial else corner


def resolved_band(span: FreeSpaceSpan) -> FrequencyBand:
    """Return the band of all frequencies that a smooth field's samples resolve, without a taper.

    Raises ToleranceError if some rays of the field are grazing.
    """
    axes = []
    for axis, (carrier, pitch) in enumerate(zip(span.carrier, span.source.pitch, strict=True)):
        ends = carrier - 0.5 / pitch, carrier + 0.5 / pitch
        axes.append(AxisBand(*ends, span.field_band(axis)))
    return _with_period(span, FrequencyBand((axes[0], axes[1]), None, 0.0))


def target_band(span: FreeSpaceSpan, epsilon: float) -> FrequencyBand:
    """Return the band of the frequencies whose rays reach the target, with smooth ends.

    epsilon: largest share of the source's light that may be lost or come from replicas.
    Raises ToleranceError if some rays to the target are grazing.
    """
    tapers = _TaperedAxes(span.numeric, epsilon)
    outer = [tapers.axis_band(axis, 0.0).largest_passed_frequency for axis in (0, 1)]
    y, x = (tapers.axis_band(axis, outer[1 - axis]) for axis in (0, 1))
    largest_y, largest_x = (max(map(abs, tangents)) for tangents in tapers.tangents)
    radial = tapers.beyond_tangent(math.hypot(largest_y, largest_x), 0.0)
    corner = math.hypot(y.largest_passed_frequency, x.largest_passed_frequency)
    cuts = not span.paraxial and radial.stop_frequency < corner
    return _with_period(span, FrequencyBand((y, x), radial if cuts else None, epsilon))


class _TaperedAxes:
    """Find, for each axis, the frequency band of the rays that reach a span's target.

    tangents: the least and largest tangent of these rays along y and x.
    """

    def __init__(self, span: FreeSpaceSpan, epsilon: float) -> None:
        self._span, self._epsilon = span, epsilon
        self._rays = PlaneWaveRays(span.wavelength, span.paraxial)
        corners = span.target_corners
        self._near = min(abs(z) for _, _, z in corners)
        self.tangents = []
        for axis in (0, 1):
            low, high = span.source_extent(axis)
            least = min((corner[axis] - high) / abs(corner[2]) for corner in corners)
            most = max((corner[axis] - low) / abs(corner[2]) for corner in corners)
            self.tangents.append((least, most))

    def beyond_tangent(self, tangent: float, across: float) -> FrequencyTaper:
        """Return the taper beyond the frequency of rays with a given tangent.

        Its width suits the least slope of the rays beyond it. If the tangent isn't positive, an
        oblique wave reaches it with a frequency of smaller modulus.
        across: largest frequency along the other axis.
        """
        rays, slowest = self._rays, 0.0
        if tangent > 0:
            edge = rays.frequency(tangent)
            slowest = min(edge, 0.999999 * rays.grazing_frequency)
        else:
            edge = rays.frequency(tangent, across)
        return FrequencyTaper(edge, rays.ray_slope(slowest, self._near), self._epsilon)

    def axis_band(self, axis: int, across: float) -> AxisBand:
        """Return the frequency band along an axis, within the field's own band."""
        span, (low, high) = self._span, self.tangents[axis]
        below, above = self.beyond_tangent(-low, across), self.beyond_tangent(high, across)
        if span.distance < 0:
            below, above = above, below
        least, most = span.field_band(axis)
        if -below.end >= most or above.end <= least:
            raise ToleranceError(
                f"tol {span.tol:g} can't be kept: none of the field's light goes towards the "
                f"target in {'yx'[axis]}; move the target, or give the band= that the light has"
            )
        passes = max(-below.stop_frequency, least), min(above.stop_frequency, most)
        return AxisBand(max(-below.end, least), min(above.end, most), passes, below, above)


def _with_period(span: FreeSpaceSpan, band: FrequencyBand) -> FrequencyBand:
    """Return a band with the least period at which no replica sends light to the target."""
    n, rays = span.numeric, PlaneWaveRays(span.numeric.wavelength, span.paraxial)
    if not band.largest_frequency < rays.grazing_frequency * (1 - 1e-9):
        raise ToleranceError(
            f"tol {span.tol:g} can't be kept by a spectrum {n.distance:g} m away: rays to the "
            "target's edge graze the source. Use direct quadrature, a smaller target, a finer "
            "band= of a smooth field, or a larger distance"
        )
    period = []
    for axis in (0, 1):
        low, high = band.axes[axis].passband
        if n.distance < 0:
            low, high = -high, -low
        left = -_largest_tangent(band, rays, axis, -low)
        right = _largest_tangent(band, rays, axis, high)
        first, last = span.source_extent(axis)
        ways = [0.0]
        for corner in n.target_corners:
            place, z = corner[axis], abs(corner[2])
            ways += [last + right * z - place, place - first - left * z]
        period.append(max(ways))
    return replace(band, period=(period[0], period[1]))


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
