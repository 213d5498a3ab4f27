"""Compute the PSF of a rotationally symmetric lens, through its stop or along its stop's rim."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.special
import torch
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray

from optics.accuracy import (
    ErrorEstimate,
    MachineSpeed,
    require_planning_time,
    unreachable_tolerance_error,
)
from optics.camera.pupil import defocus_curvature, pupil_phase
from optics.camera.stop_nodes import line_rule, line_rule_node_count
from optics.chebyshev import chebyshev_nodes
from optics.psf.engine import CachedPupilWave, PSFEngine, double_precision_error
from optics.psf.reference_probe import ERROR_MARGIN, draw_samples
from optics.psf.request import PSFRequest

_CHUNK = 1 << 23


# Phase of the fastest fringe of the field over half a cell, in radians. More takes fewer radii
# but polynomials of a higher degree; 4 was measured to be fast.
_HALF_TURN = 4.0

_POLYNOMIAL_TOL_SHARE = 0.1  # share of the tolerance that the polynomials may use. Chosen.

_PROBED_SAMPLES = 64  # samples at which the error is measured. Chosen.

_PASSES_PER_TERM = 5.0  # passes over a place for each coefficient of the polynomial; measured

_PLANNING_CALLS = 4.0  # fixed cost of planning in calls; measured

_PLANNING_PASSES = 20.0  # passes over the samples while the error is measured; measured


class AxialEngine(CachedPupilWave, PSFEngine):
    """Computes the PSF of a round lens by a Hankel transform and polynomials along the radius.

    For a rotationally symmetric pupil, the two-dimensional integral (thesis Eq. 2.13) is

        U(s) = 2 pi integral of exp(i phase(r)) J0(2 pi r s / (wavelength z)) r dr,

    summed by Gauss-Legendre nodes on the Chebyshev nodes of short cells of radii s. The stop's
    diameter limits the field's bandwidth along s, so that polynomials through these nodes converge
    faster than any power (Trefethen 2008). The intensity's polynomials are evaluated at the radius
    of every sample; samples at the same distances from both axes are evaluated once. Far out of
    focus, where the matrix would become too large, the field of a thin lens comes from an integral
    along the stop's rim instead.
    """

    precision = "float64"

    def __init__(self, request: PSFRequest) -> None:
        if not self.can_serve(request):
            raise ValueError(
                "method is 'axial'; it serves round stops and aberrations only, and no derivatives "
                "that move the light on the samples"
            )
        self._request = request
        q = request.numeric
        self.arithmetic = double_precision_error(q)
        self._cost = _HankelCost.of(q)
        self._along_rim = not request.differentiable and _prefers_rim(q, self._cost)
        self.name = "rim integral" if self._along_rim else "Hankel transform"

    @staticmethod
    def can_serve(request: PSFRequest) -> bool:
        """Tell whether the lens is round, and no derivative moves the light on the samples.

        The stop and the aberrations of a round lens are rotationally symmetric.
        """
        lens = request.lens
        round_ = all(m == 0 for _, m, _ in lens.aberrations)
        return (
            lens.stop.annulus_radii is not None and round_ and not request.needs_geometry_gradient
        )

    @property
    def bytes(self) -> int:
        return self._cost.bytes(self._along_rim)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._cost.cpu_seconds(speed, self._along_rim)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return self._cost.planning_seconds(speed, self._along_rim)

    def prepare(self) -> None:
        q = self._request.numeric
        self._cells = RadialCells.of(q)
        sensor = self._cells.radii
        self._samples = [
            torch.unique(axis.abs().ravel(), return_inverse=True) for axis in q.samples.mesh()
        ]
        self._places = self._cells.locate(
            torch.hypot(self._samples[0][0][:, None], self._samples[1][0][None, :])
        )
        if self._along_rim:
            self._cached_rim_field = torch.from_numpy(rim_field(q, sensor))
            self.sampling = f"{rim_node_count(q, q.tol)} nodes on the rim, {sensor.size} radii"
        else:
            self._pupil_radii, self._pupil_weights = _radial_rule(q, 1.0)
            bessel = scipy.special.j0(
                np.outer(sensor, self._pupil_radii.numpy()) * (_radians_per_metre(q))
            )
            self._hankel_matrix = torch.from_numpy(bessel) * self._pupil_weights
            self.sampling = (
                f"{self._pupil_radii.numel()} radii in the stop, {sensor.size} on the sensor"
            )
        require_planning_time("a round lens' PSF")
        with torch.no_grad():
            light = self.intensity(None, None)
        require_planning_time("a round lens' PSF")
        self.error = self._measure_error(light)
        if not self.error.value + self.arithmetic <= q.tol:
            raise unreachable_tolerance_error(q.tol, 1.2 * self.error.value + self.arithmetic)
        self._keep_first_light(light)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the points on one pupil radius where a pattern is given.

        A phase there holds for all angles.
        """
        if self._along_rim:
            empty = torch.zeros(0, dtype=torch.float64)
            return empty, empty
        return torch.zeros_like(self._pupil_radii), self._pupil_radii * self._request.numeric.radius

    def _compute_pupil_wave(self) -> torch.Tensor:
        """Compute the wave along one pupil radius."""
        q = self._request
        phase = pupil_phase(
            q.lens, q.distance, q.wavelength, torch.zeros_like(self._pupil_radii), self._pupil_radii
        )
        return torch.polar(torch.ones_like(phase), phase)

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        first = self._first_light(phase, amplitude)
        if first is not None:
            return first
        if self._along_rim:
            if phase is not None or amplitude is not None:
                raise ValueError(
                    "so far out of focus, a round lens takes no extra phase or amplitude; give it "
                    "aberrations, or bring the object closer to the plane in focus"
                )
            parts = torch.view_as_real(self._cached_rim_field)
        else:
            wave = self._pupil_wave()
            factor = self.modulation_factor(phase, amplitude, (self._pupil_radii.numel(),))
            self.require_resolved(phase, amplitude)
            wave = wave if factor is None else wave.to(factor.device) * factor
            parts = self._sum_over_pupil_radii(wave)
        coefficients = self._cells.intensity_coefficients(parts)
        (_, rows), (_, columns) = self._samples
        # Interpolation may fall a little below zero where there is no light.
        light = self._cells.evaluate(coefficients, self._places).clamp(min=0.0)
        light = light * self._request.intensity_scale
        light = light.index_select(-2, rows.to(light.device)).index_select(
            -1, columns.to(light.device)
        )
        if phase is not None or amplitude is not None:
            self._tell_pattern_error(light)
        return light

    def _sum_over_pupil_radii(self, wave: torch.Tensor) -> torch.Tensor:
        """Sum a wave over pupil radii to the field at radii on the sensor.

        The result holds real and imaginary part, (..., radii, 2).

        wave: complex, (..., pupil radii).
        """
        matrix = self._hankel_matrix.to(wave.device)
        return (torch.view_as_real(wave).mT @ matrix.mT).mT

    def _measure_error(self, light: torch.Tensor) -> ErrorEstimate:
        """Measure the error at some samples against the sum of a finer rule."""
        q = self._request.numeric
        count = _PROBED_SAMPLES
        if self._along_rim:
            count = min(count, max(4, _CHUNK // rim_node_count(q, q.tol)))
        seen = light[q.window_slices].to(torch.float64).numpy()
        where, weight = draw_samples(seen, count)
        y, x = (q.samples.coordinates(axis)[q.window_slices[axis]].numpy() for axis in (0, 1))
        rows, columns = np.unravel_index(where, seen.shape)
        radius = np.hypot(y[rows], x[columns])
        if self._along_rim:
            field = rim_field(q, radius, refinement=1.5)
        else:
            r, w = _radial_rule(q, 1.5)
            bessel = scipy.special.j0(np.outer(radius, r.numpy()) * _radians_per_metre(q))
            phase = pupil_phase(q.lens, q.distance, q.wavelength, torch.zeros_like(r), r)
            field = (bessel * w.numpy()) @ np.exp(1j * phase.numpy())
        truth = q.intensity_scale * np.abs(field) ** 2
        error = math.sqrt(float((weight * (seen.ravel()[where] - truth) ** 2).sum()))
        size = float(np.linalg.norm(seen))
        how = f"measured on {where.size} samples against a finer rule"
        return ErrorEstimate(ERROR_MARGIN * error / size if size > 0 else math.inf, how)


def _radians_per_metre(q: PSFRequest) -> float:
    """Return the phase of the kernel, in radians per metre and stop radius.

    The metres are on the sensor, the stop radii in the pupil.
    """
    return 2 * math.pi * q.radius / q.scale


def _radial_rule(q: PSFRequest, finer: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Return radii, in stop radii, and weights that integrate over the open pupil.

    finer: factor on the phase's slope for which they are chosen.
    """
    assert q.lens.stop.annulus_radii is not None
    inner, outer = q.lens.stop.annulus_radii
    t, weight = line_rule(outer - inner, finer * _radial_phase_slope(q), q.tol)
    radii = inner + (outer - inner) * t
    area = 2 * np.pi * (outer - inner) * weight * radii
    return torch.from_numpy(radii), torch.from_numpy(area)


def _radial_phase_slope(q: PSFRequest) -> float:
    return q.phase_slope_bound.radial(1.0) + q.phase_slope_bound.tilt


class RadialCells:
    """Describes rotationally symmetric light by polynomials of the radius in many equal cells.

    The field is given on `radii`, at the Chebyshev nodes of cells of `width` metres. The intensity
    has twice the field's bandwidth, so that its cells are half as wide.
    """

    def __init__(self, width: float, count: int, degree: int) -> None:
        nodes = chebyshev_nodes(degree + 1)
        self._step = width / 2
        self._count, self._degree = count, degree
        self.radii: NDArray[np.float64] = (
            (np.arange(count)[:, None] + (nodes + 1) / 2) * width
        ).ravel()
        to_coefficients = np.linalg.inv(chebvander(nodes, degree))
        halves = np.concatenate(((nodes - 1) / 2, (nodes + 1) / 2))
        self._to_halves = torch.from_numpy((chebvander(halves, degree) @ to_coefficients).T.copy())
        self._to_coefficients = torch.from_numpy(to_coefficients.T.copy())

    @staticmethod
    def of(q: PSFRequest) -> RadialCells:
        """Choose the cells for the samples and the tolerance of a request."""
        width, count = _cell_width_and_count(q)
        return RadialCells(width, count, _polynomial_degree(q.tol))

    def locate(self, radius: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return each radius' cell of the intensity, and twice its place there, -2 to 2."""
        place = radius / self._step
        cell = place.floor()
        return cell.to(torch.int64), 4 * (place - cell) - 2

    def intensity_coefficients(self, parts: torch.Tensor) -> torch.Tensor:
        """Return the intensity's Chebyshev coefficients in its cells, (..., degree + 1, cells).

        parts: real and imaginary part of the field, (..., radii, 2).
        """
        nodes = self._degree + 1
        cells = parts.mT.reshape(*parts.shape[:-2], 2, self._count, nodes)
        finer = cells @ self._to_halves.to(parts.device)
        light = finer.square().sum(-3).reshape(*parts.shape[:-2], 2 * self._count, nodes)
        return (light @ self._to_coefficients.to(parts.device)).mT.contiguous()

    def evaluate(
        self, coefficients: torch.Tensor, places: tuple[torch.Tensor, torch.Tensor]
    ) -> torch.Tensor:
        """Evaluate the intensity at places of locate(), by Clenshaw's recurrence."""
        cell, twice = (one.to(coefficients.device) for one in places)
        shape, flat = (*coefficients.shape[:-2], *cell.shape), cell.ravel()
        twice = twice.ravel()

        def term(degree: int) -> torch.Tensor:
            return coefficients[..., degree, :].index_select(-1, flat)

        last = term(self._degree)
        before = torch.addcmul(term(self._degree - 1), twice, last)
        for degree in range(self._degree - 2, 0, -1):
            before, last = torch.addcmul(term(degree) - last, twice, before), before
        return torch.addcmul(term(0) - last, twice, before, value=0.5).reshape(shape)


def _cell_width_and_count(q: PSFRequest) -> tuple[float, int]:
    """Return the width in metres and the number of the field's cells."""
    assert q.lens.stop.annulus_radii is not None
    width = 2 * _HALF_TURN / (_radians_per_metre(q) * q.lens.stop.annulus_radii[1])
    return width, math.ceil(q.farthest_sample_radius / width * (1 + 1e-12)) + 1


def _polynomial_degree(tol: float) -> int:
    """Return the degree of the polynomials that keep a tolerance.

    The polynomial of exp(i a t) on Chebyshev nodes leaves out Bessel functions J_n(a) of n beyond
    the degree; the first one dominates (Trefethen 2008).
    """
    allowed = _POLYNOMIAL_TOL_SHARE * tol / 4
    first = np.abs(scipy.special.jv(np.arange(5, 41), _HALF_TURN))
    return 4 + int(np.count_nonzero(first > allowed))


@dataclass
class _HankelCost:
    """Predicts memory and time of a Hankel transform or a rim integral.

    nodes: number of nodes in the pupil.
    field_radii: number of radii at which the field is summed.
    terms: number of coefficients of a polynomial.
    places: number of different places among the samples.
    """

    request: PSFRequest
    nodes: int
    field_radii: int
    terms: int
    places: int

    @staticmethod
    def of(q: PSFRequest) -> _HankelCost:
        assert q.lens.stop.annulus_radii is not None
        inner, outer = q.lens.stop.annulus_radii
        degree = _polynomial_degree(q.tol)
        nodes = line_rule_node_count(outer - inner, _radial_phase_slope(q), q.tol)
        different = [
            n if centre else n // 2 + 1
            for n, centre in zip(q.samples.shape, q.samples.centre, strict=True)
        ]
        radii = _cell_width_and_count(q)[1] * (degree + 1)
        return _HankelCost(q, nodes, radii, degree + 1, different[0] * different[1])

    @cached_property
    def samples(self) -> int:
        return self.request.samples.shape[0] * self.request.samples.shape[1]

    def bytes(self, along_rim: bool) -> int:
        rest = 6 * self.places + 2 * self.samples
        return 8 * (rest + (2 * self.field_radii if along_rim else self.field_radii * self.nodes))

    def cpu_seconds(self, speed: MachineSpeed, along_rim: bool) -> float:
        sums = 0.0 if along_rim else self.field_radii * self.nodes * speed.stream
        passes = self.terms * self.places * _PASSES_PER_TERM + 2 * self.samples
        return speed.call + sums + passes * speed.touch * speed.double

    def planning_seconds(self, speed: MachineSpeed, along_rim: bool) -> float:
        """Predict the time before the first call: the matrix, a call and the judgement."""
        if along_rim:
            rim = rim_node_count(self.request, self.request.tol)
            kernels = 2 * rim * (self.field_radii + 1.5 * _PROBED_SAMPLES)
        else:
            kernels = self.nodes * (self.field_radii + 1.5 * _PROBED_SAMPLES)
        rest = _PLANNING_CALLS * speed.call + _PLANNING_PASSES * self.samples * speed.touch
        return self.cpu_seconds(speed, along_rim) + kernels * speed.bessel + rest


def _prefers_rim(q: PSFRequest, size: _HankelCost) -> bool:
    """Tell whether the rim integral takes far fewer nodes than a rule along the radius."""
    if not q.lens.has_quadratic_phase:
        return False
    return size.nodes * size.field_radii > _CHUNK and size.nodes > 2 * rim_node_count(q, q.tol)


_RIM_INTEGRAL_CHUNK = 1 << 21


def rim_node_count(q: PSFRequest, tol: float, refinement: float = 1.0) -> int:
    """Return how many evenly spaced nodes on the stop's rim suffice for the farthest sample."""
    turn = refinement * q.phase_slope_bound.tilt
    # The integrand has a narrow peak if the point of the stop that is imaged onto the sample lies
    # near the rim.
    peak = 6 * math.sqrt(abs(_edge_defocus(q)))
    return math.ceil(turn + 4 * turn ** (1 / 3) + refinement * peak - 2 * math.log10(tol)) + 16


def _edge_defocus(q: PSFRequest) -> float:
    """Return the phase of the defocus at the stop's edge, in radians."""
    curvature: float = defocus_curvature(q.lens, q.distance, q.wavelength)
    return curvature * q.radius**2


def rim_field(
    q: PSFRequest, sensor: NDArray[np.float64], refinement: float = 1.0
) -> NDArray[np.complex128]:
    """Compute the field at radii on the sensor, in square stop radii, complex128.

    The phase is quadratic, c |r - p|², around the point p of the stop that is imaged geometrically
    onto the sample. Green's theorem turns the integral over the stop into

        U = 1/2 closed integral of g(c rho²) (rho x d rho),   g(a) = (exp(i a) - 1) / (i a),

    along the rim, with rho measured from p, up to a phase that doesn't affect the intensity. This
    is the boundary diffraction wave of Maggi and Rubinowicz, which is exact in the paraxial case.
    The number of nodes grows only with the square root of the defocus. The integral along an
    obscuration's rim is subtracted.

    sensor: radii in metres.
    """
    assert q.lens.stop.annulus_radii is not None
    c, tilt = _edge_defocus(q), 2 * math.pi * q.radius / q.scale
    count = rim_node_count(q, q.tol, refinement)
    inner, outer = q.lens.stop.annulus_radii
    field = np.zeros(sensor.size, dtype=np.complex128)
    # The integrand is symmetric about the line through the sample, so half of the rim is enough.
    half = count // 2 + 1
    angle = 2 * math.pi * np.arange(half) / (2 * (half - 1))
    weight = np.full(half, 2.0)
    weight[[0, -1]] = 1.0
    weight *= 2 * math.pi / (2 * (half - 1))
    for start in range(0, sensor.size, _RIM_INTEGRAL_CHUNK // half + 1):
        require_planning_time("the integral along the stop's rim")
        part = slice(start, start + _RIM_INTEGRAL_CHUNK // half + 1)
        middle = tilt * sensor[part, None] / (2 * c)
        for radius, sign in ((outer, 1), (inner, -1)):
            if radius == 0:
                continue
            # These forms of rho² and rho x d rho / d angle lose no digits near the rim.
            across = 2 * radius * middle * (1 - np.cos(angle))
            rho2 = (radius - middle) ** 2 + across
            turned = radius * (radius - middle) + across / 2
            field[part] += sign / 2 * ((_g(c * rho2) * turned) @ weight)
    return field


def _g(a: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return (exp(i a) - 1) / (i a), computed as exp(i a / 2) sinc(a / 2)."""
    return np.exp(0.5j * a) * np.sinc(a / (2 * math.pi))
