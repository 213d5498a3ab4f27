"""Fresnel's integral in one Fourier transform, or in two."""

from __future__ import annotations

import math
from dataclasses import dataclass

import scipy.fft
import torch

from optics.accuracy import ToleranceError
from optics.fourier.fft import fft_operations
from optics.fourier.separable import chirp_length
from optics.plane import Plane
from optics.propagation.chirped import (
    CellSampling,
    ChirpedPropagator,
    ChirpedTransform,
    envelope_error,
    envelope_node_count,
)
from optics.propagation.paraxial import (
    Interval,
    diffraction_margin,
    replicas_miss_target,
    step_widths,
    target_ray_frequencies,
)
from optics.propagation.propagator import Share, phase_rounding, working_precision
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.spectral_propagator import transform_error_share


class SingleFresnel(ChirpedPropagator):
    """Use one Fourier transform between two chirps (section 4.2.1 of Goodman).

    The target may have any pitch and window. A smooth field is summed over its samples, which
    requires a distance at which no replica of its spectrum sends light to the target
    (optics.propagation.paraxial). Cells are exact at any distance, but at short distances they
    need one transform for each of several nodes (optics.propagation.chirped).
    """

    name = "single Fresnel transform"
    search_calls = 16

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        n = self._paraxial_span.numeric
        cells, sampling = None, Share.SAMPLING * n.sampling_tol
        if n.cells is None:
            for axis, pitch in enumerate(n.source.pitch):
                if _replicas_miss(n, axis, target_ray_frequencies(n, axis), n.scale):
                    continue
                raise ToleranceError(
                    f"tol {n.tol:g} can't be kept by the {self.name}: samples {pitch:g} m apart in "
                    f"{'yx'[axis]} send copies of the field to a target {n.distance:g} m away; "
                    "sample finer, give the field's band= if it is narrower, or use the two-step "
                    "transform"
                )
        else:
            cells, sampling = plan_cell_sampling(n, n.scale, sampling)
        share, ways = Share.SAMPLING + 2 * Share.TRANSFORM, (n.lateral_range(0), n.lateral_range(1))
        # The kernel's phase between the two farthest points.
        turns = max(max(map(abs, way)) ** 2 for way in ways) / (2 * abs(n.scale))
        self.dtype, self.arithmetic = working_precision(n.tol - self._model_error, turns, share)
        step = ChirpedTransform(
            n.source, span.target, span.scale, self.dtype, n.budget,
            error=transform_error_share(n), cells=cells,
        )  # fmt: skip
        self._steps = (step,)
        self._set_error_bound(
            self._model_error + sampling + 2 * step.error, share, self._model_error
        )
        terms = f", {cells.nodes[1]}x{cells.nodes[0]} nodes" if cells else ""
        rows, columns = n.source.shape
        self.sampling = f"{columns}x{rows} source samples{terms}, {step.name}"


def _replicas_miss(span: FreeSpaceSpan, axis: int, reach: Interval, scale: float) -> bool:
    """Return whether replicas of a smooth field's spectrum have no rays of frequencies in `reach`.

    scale: wavelength times distance to the plane that they must miss, square metres.
    """
    epsilon, pitch = Share.REPLICA * span.sampling_tol, span.source.pitch[axis]
    return replicas_miss_target(span.field_band(axis), pitch, reach, abs(scale), epsilon)


def plan_cell_sampling(
    span: FreeSpaceSpan, scale: float, error: float
) -> tuple[CellSampling, float]:
    """Return the envelope nodes for cells, and the resulting error.

    scale: of the transform, square metres. error: the error allowed. Raises ToleranceError if the
    chirp varies too fast across the outermost cells.
    """
    n = span.numeric
    assert n.cells is not None
    nodes, costs = [], []
    for axis, side in enumerate(n.cells):
        farthest = (span.source.shape[axis] - 1) * span.source.pitch[axis] / 2
        turn = 2 * math.pi * farthest * side / abs(scale)
        # With more than 6 nodes, and so transforms, along an axis, other methods are cheaper.
        count = envelope_node_count(turn, error / 2, 6)
        if not count:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept by a single Fresnel transform: the chirp turns by "
                f"{turn:.2g} rad across the outermost cells; use the Fresnel matrices"
            )
        nodes.append(count)
        costs.append(3 * envelope_error(turn, count))
    return CellSampling(n.cells, (nodes[0], nodes[1])), sum(costs)


# Positions of the intermediate plane that are tried, over the distance from source to target.
#
# Near targets need a plane beyond the target or behind the source, where the chirps vary less.
_PLANE_POSITIONS = tuple(
    sign * 2.0 ** (k / 2) for k in range(-6, 25) for sign in (1.0, -1.0) if (sign, k) != (1.0, 0)
)


@dataclass(frozen=True)
class IntermediateAxis:
    """The samples of the intermediate plane along one axis, in metres.

    low, high: first and last position. pitch: largest distance between samples.
    below, above: (centre, sigma) of the smooth steps at either end; None where the field has died
        away without a taper.
    """

    low: float
    high: float
    pitch: float
    below: tuple[float, float] | None
    above: tuple[float, float] | None

    @property
    def count(self) -> int:
        return math.ceil((self.high - self.low) / self.pitch * (1 - 1e-12)) + 1

    def taper(self, x: torch.Tensor) -> torch.Tensor:
        value = torch.ones_like(x)
        for sign, step in ((1.0, self.above), (-1.0, self.below)):
            if step is not None:
                centre, sigma = step
                value = value * torch.erfc(sign * (x - centre) / (math.sqrt(2) * sigma)) / 2
        return value


_Axes = tuple[IntermediateAxis, IntermediateAxis]


class TwoStepFresnel(ChirpedPropagator):
    """Use one Fresnel transform to an intermediate plane and one from there to the target.

    The method is that of Schmidt (2010, Numerical Simulation of Optical Wave Propagation,
    10.1117/3.866274, equations 6.24 to 6.29) and Voelz (2011, Computational Fourier Optics,
    10.1117/3.858456, appendix).

    A near target violates the sampling criterion of a single transform. A plane that is farther
    away, beyond the target or behind the source, meets it, and the light is propagated from there
    back to the target. With t the plane's distance over the target's, two conditions hold:

    * The light from a point x_s to x_t passes through x_s + t (x_t - x_s), except for diffraction.
      A step of width sigma at a distance delta from there removes the same share of it as a step in
      the spectrum (optics.propagation.paraxial), with 1 / |scale t (1 - t)| in place of dX/df. So
      the plane ends smoothly just beyond all such points, or beyond all light of a smooth field if
      that is less.
    * Samples of the plane with pitch p make replicas of the target's light every
      |scale (1 - t)| / p. The replicas must miss the target. (A field that is multiplied by fringes
      of frequency 1 / p is displaced by that much.)

    Where both hold, the sums equal the integrals within the tolerance. The cheapest such plane is
    used.
    """

    name = "two-step Fresnel"
    search_calls = 40

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        # Errors on the intermediate plane are taken to be all on the target.
        self.rounding_share = 1.0
        n = self._paraxial_span.numeric
        part, self._tapers, cells = self._cheapest_plane()
        plane = self._intermediate_plane = _sampled_plane(self._tapers)
        share, turns = 2 * Share.SAMPLING + 4 * Share.TRANSFORM, self._turns(part, self._tapers)
        self.dtype, self.arithmetic = working_precision(n.tol - self._model_error, turns, share)
        scale, error = span.scale, transform_error_share(n)
        first = ChirpedTransform(
            n.source, plane, part * scale, self.dtype, n.budget, error=error, cells=cells
        )
        second = ChirpedTransform(
            plane, span.target, (1 - part) * scale, self.dtype, n.budget, error=error
        )
        self._steps = (first, second)
        sampling = 2 * Share.SAMPLING * n.sampling_tol + 2 * (first.error + second.error)
        self._set_error_bound(self._model_error + sampling, share, self._model_error)
        rows, columns = plane.shape
        self.sampling = f"{columns}x{rows} samples at {part:.3g} of the way"

    def _cheapest_plane(self) -> tuple[float, _Axes, CellSampling | None]:
        """Return where the cheapest intermediate plane is, its samples, and nodes for cells."""
        n, best, cells = self._paraxial_span.numeric, math.inf, None
        found: tuple[float, _Axes, CellSampling | None] | None = None
        # The derivatives of both steps nearly cancel, and lose more digits the farther away the
        # plane is. So its distance is limited where derivatives are needed.
        farthest = 8.0 if self._paraxial_span.differentiable else math.inf
        allowed = Share.CHIRP_ROUNDING * n.tol
        for part in (part for part in _PLANE_POSITIONS if abs(part) <= farthest):
            if n.cells is not None:
                try:
                    error = Share.SAMPLING * n.sampling_tol
                    cells, _ = plan_cell_sampling(n, part * n.scale, error)
                except ToleranceError:
                    continue
            y, x = _intermediate_axis(n, 0, part), _intermediate_axis(n, 1, part)
            if y is None or x is None or phase_rounding(self._turns(part, (y, x))) > allowed:
                continue
            terms = cells.nodes[0] * cells.nodes[1] if cells else 1
            shape = (y.count, x.count)
            work = terms * _chirp_z_operations(n.source.shape, shape)
            work += _chirp_z_operations(shape, n.target.shape)
            if work < best:
                best, found = work, (part, (y, x), cells)
        if found is None:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept by {self.name} transforms: from no plane between do "
                "samples of this pitch send all copies past the target; sample finer, give the "
                "field's band= if it is narrower, or use the Fresnel matrices"
            )
        return found

    def _turns(self, part: float, axes: _Axes) -> float:
        """Return the largest phase of the chirps of both steps, in turns."""
        n = self._paraxial_span.numeric
        most = 0.0
        for axis, between in enumerate(axes):
            wide = (between.high - between.low) / 2
            first, last = n.source_extent(axis)
            way = max(abs(between.high - first), abs(last - between.low))
            places = _target_ends(n, axis)
            on = max(abs(p - (between.low + between.high) / 2) for p in places)
            most = max(most, way**2 / abs(part), (wide**2 + on**2) / abs(1 - part))
        return most / (2 * abs(n.scale))

    @property
    def bytes(self) -> int:
        rows, columns = self._intermediate_plane.shape
        between = 2 * self.dtype.itemsize * rows * columns
        return super().bytes + between

    def _taper_ends(self, field: torch.Tensor) -> torch.Tensor:
        for axis, between in enumerate(self._tapers):
            taper = between.taper(self._intermediate_plane.coordinates(axis)).to(
                field.device, field.real.dtype
            )
            field = field * (taper if axis else taper[:, None])
        return field


def _intermediate_axis(span: FreeSpaceSpan, axis: int, part: float) -> IntermediateAxis | None:
    """Plan an intermediate plane along one axis; None if it isn't valid there.

    part: of the distance, at which the plane lies. span: with plain numbers.
    """
    source, target = span.source_extent(axis), _target_ends(span, axis)
    epsilon = Share.REPLICA * span.sampling_tol
    # A taper in this plane acts on chirps of 1 / (t (1 - t) scale), just as a taper in the spectrum
    # acts on chirps of dX/df.
    kappa = 1 / (abs(span.scale) * abs(part * (1 - part)))
    step_width, dark_margin = step_widths(kappa, math.inf, epsilon)
    sigma = step_width / math.sqrt(2 * math.log(1 / epsilon))
    through = [a + part * (b - a) for a in source for b in target]
    below: tuple[float, float] | None = (min(through) - dark_margin, sigma)
    above: tuple[float, float] | None = (max(through) + dark_margin, sigma)
    low = min(through) - dark_margin - step_width
    high = max(through) + dark_margin + step_width
    if span.cells is None:
        first, last = _smooth_light_interval(span, axis, part)
        left, right = max(low, first), min(high, last)
        scale = part * span.scale
        reach = sorted(way / scale for way in (left - source[1], right - source[0]))
        if not left < right or not _replicas_miss(span, axis, (reach[0], reach[1]), scale):
            return None
        below, above = below if left == low else None, above if right == high else None
        low, high = left, right
    # Replicas of the part of the target's plane that the light reaches must miss the target.
    dark = dark_margin - step_width
    ends = (low - (dark if below else 0.0), high + (dark if above else 0.0))
    ways = [a + (b - a) / part for a in source for b in ends]
    first, last = min(ways), max(ways)
    if span.cells is None:
        whole = _smooth_light_interval(span, axis, 1.0)
        first, last = max(first, whole[0]), min(last, whole[1])
    pitch = abs((1 - part) * span.scale) / max(last - target[0], target[1] - first)
    return IntermediateAxis(low, high, pitch, below, above)


def _smooth_light_interval(span: FreeSpaceSpan, axis: int, part: float) -> Interval:
    """Return where a smooth field's light is after a part of the distance."""
    scale, band, source = part * span.scale, span.field_band(axis), span.source_extent(axis)
    epsilon = Share.REPLICA * span.sampling_tol
    margin = diffraction_margin(abs(scale), band, span.source.pitch[axis], epsilon)
    rays, spread = sorted(scale * frequency for frequency in band), abs(scale) * margin
    return source[0] + rays[0] - spread, source[1] + rays[1] + spread


def _target_ends(span: FreeSpaceSpan, axis: int) -> Interval:
    """Return the least and largest position of the target's samples on an axis, in metres."""
    places = [corner[axis] for corner in span.target_corners]
    return min(places), max(places)


def _sampled_plane(axes: _Axes) -> Plane:
    """Return the intermediate plane, with sample counts that suit FFTs."""
    shape, pitch, centre = [], [], []
    for axis in axes:
        count = scipy.fft.next_fast_len(axis.count)
        step = (axis.high - axis.low) / (count - 1) if count > 1 else axis.pitch
        shape.append(count)
        pitch.append(step)
        centre.append(axis.low + (count // 2) * step)
    return Plane((shape[0], shape[1]), (pitch[0], pitch[1]), (centre[0], centre[1]))


def _chirp_z_operations(source: tuple[int, int], target: tuple[int, int]) -> float:
    """Estimate the operations of a chirp-Z transform between two planes."""
    rows, columns = (chirp_length(n, m) for n, m in zip(source, target, strict=True))
    return source[1] * fft_operations(rows) + target[0] * fft_operations(columns)
