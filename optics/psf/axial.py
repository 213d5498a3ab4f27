"""Compute the PSF of a rotationally symmetric lens."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.special
import torch

from optics.accuracy import ErrorEstimate, MachineSpeed, unreachable_tolerance_error
from optics.psf.reference_probe import ERROR_MARGIN
from optics.psf.rim_integral import rim_field, rim_node_count
from optics.psf_engines.engine import CachedPupilWave, PSFEngine, double_precision_error
from optics.psf_engines.request import PSFRequest
from optics.pupil import pupil_phase
from optics.stop.quadrature import line_rule, line_rule_node_count

_OVERSAMPLING = 2.0
"""Sampling rate of the field along the radius, over its Nyquist rate."""

_CHUNK = 1 << 23


class AxialEngine(CachedPupilWave, PSFEngine):
    """Computes the PSF of a round lens by a Hankel transform and interpolation along the radius.

    For a rotationally symmetric pupil, the two-dimensional integral (thesis Eq. 2.13) is

        U(s) = 2 pi integral of exp(i phase(r)) J0(2 pi r s / (wavelength z)) r dr,

    summed by Gauss-Legendre nodes on evenly spaced radii s. The stop's diameter limits the field's
    bandwidth along s, so a Kaiser-windowed sinc interpolates it at the radius of every sample
    (Kaiser 1974). Far out of focus, where the matrix would become too large, the field of a thin
    lens comes from an integral along the stop's rim instead.
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
        """Tell whether the lens is round, and no derivative moves its PSF on the samples.

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

    def prepare(self) -> None:
        q = self._request.numeric
        y, x = q.samples.mesh()
        radius, self._radius_index = torch.unique(torch.hypot(y, x), return_inverse=True)
        self._cost.radii = radius.numel()
        spacing = self._cost.spacing
        self._taps, self._weights = _interpolation(radius.numpy() / spacing, self._cost.reach)
        sensor = np.arange(self._cost.field_radii, dtype=np.float64) * spacing
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
        self.error = self._measure_error(radius)
        if not self.error.value + self.arithmetic <= q.tol:
            raise unreachable_tolerance_error(q.tol, 1.2 * self.error.value + self.arithmetic)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the points on one pupil radius where the symmetric PSF takes its phase.

        A phase there holds for all angles.
        """
        if self._along_rim:
            empty = torch.zeros(0, dtype=torch.float64)
            return empty, empty
        return torch.zeros_like(self._pupil_radii), self._pupil_radii * self._request.numeric.radius

    def _compute_pupil_wave(self) -> torch.Tensor:
        """Compute the wave along one pupil radius of the round lens, for its PSF."""
        q = self._request
        phase = pupil_phase(
            q.lens, q.distance, q.wavelength, torch.zeros_like(self._pupil_radii), self._pupil_radii
        )
        return torch.polar(torch.ones_like(phase), phase)

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
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
            self.require_phase_slope(phase)
            wave = wave if factor is None else wave.to(factor.device) * factor
            parts = self._sum_over_pupil_radii(wave)
        return (
            self._intensity_on_radii(parts)[..., self._radius_index] * self._request.intensity_scale
        )

    def _sum_over_pupil_radii(self, wave: torch.Tensor) -> torch.Tensor:
        """Sum a wave over a round lens' pupil radii to the PSF's field at radii on the sensor.

        wave: complex, (..., pupil radii). The result holds real and imaginary part, (..., radii,
        2).
        """
        matrix = self._hankel_matrix.to(wave.device)
        return (torch.view_as_real(wave).mT @ matrix.mT).mT

    def _intensity_on_radii(self, parts: torch.Tensor) -> torch.Tensor:
        """Interpolate the symmetric PSF's intensity at every radius of the samples.

        parts: real and imaginary part of the field, (..., radii, 2).
        """
        taps, weights = self._taps.to(parts.device), self._weights.to(parts.device)
        near = (parts[..., taps, :] * weights[..., None]).sum(-2)
        return near[..., 0] ** 2 + near[..., 1] ** 2

    def _measure_error(self, radius: torch.Tensor) -> ErrorEstimate:
        """Measure the symmetric PSF's error at some radii, against an uninterpolated finer sum."""
        q = self._request.numeric
        times = torch.bincount(
            self._radius_index[q.window_slices].ravel(), minlength=radius.numel()
        )
        seen = torch.nonzero(times).ravel()
        # 64 radii represent all of them.
        count = min(64, seen.numel())
        if self._along_rim:
            count = min(count, max(4, _CHUNK // rim_node_count(q, q.tol)))
        chosen = seen[torch.linspace(0, seen.numel() - 1, count).round().long()]
        if self._along_rim:
            truth = np.abs(rim_field(q, radius[chosen].numpy(), refinement=1.5)) ** 2
        else:
            r, w = _radial_rule(q, 1.5)
            bessel = scipy.special.j0(
                np.outer(radius[chosen].numpy(), r.numpy()) * _radians_per_metre(q)
            )
            phase = pupil_phase(q.lens, q.distance, q.wavelength, torch.zeros_like(r), r)
            truth = np.abs((bessel * w.numpy()) @ np.exp(1j * phase.numpy())) ** 2
        with torch.no_grad():
            kept = self._cached_rim_field if self._along_rim else None
            parts = (
                self._sum_over_pupil_radii(self._pupil_wave())
                if kept is None
                else torch.view_as_real(kept)
            )
            value = self._intensity_on_radii(parts)[chosen].numpy()
        # Each radius is weighted by the number of samples on it.
        often = times[chosen].numpy()
        error = math.sqrt(float((often * (value - truth) ** 2).sum()))
        size = math.sqrt(float((often * truth**2).sum()))
        how = f"measured on {count} radii against a finer rule"
        return ErrorEstimate(ERROR_MARGIN * error / size if size > 0 else math.inf, how)


def _radians_per_metre(q: PSFRequest) -> float:
    """Return the phase of the symmetric PSF's kernel, in radians per metre and stop radius.

    The metres are on the sensor, the stop radii in the pupil.
    """
    return 2 * math.pi * q.radius / q.scale


def _radial_rule(q: PSFRequest, finer: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Return radii and weights that integrate over a round lens' open pupil for its PSF.

    The radii are in stop radii. finer: factor on the phase's slope for which they are chosen.
    """
    assert q.lens.stop.annulus_radii is not None
    inner, outer = q.lens.stop.annulus_radii
    t, weight = line_rule(outer - inner, finer * _radial_phase_slope(q), q.tol)
    radii = inner + (outer - inner) * t
    area = 2 * np.pi * (outer - inner) * weight * radii
    return torch.from_numpy(radii), torch.from_numpy(area)


def _radial_phase_slope(q: PSFRequest) -> float:
    return q.phase_slope_bound.radial(1.0) + q.phase_slope_bound.tilt


def _interpolation(position: np.ndarray, reach: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the radii and weights that interpolate the symmetric PSF's field at each position.

    The field is even in the radius, so that negative radii count as positive ones.
    """
    first = np.floor(position).astype(np.int64) - reach + 1
    taps = first[:, None] + np.arange(2 * reach)
    away = position[:, None] - taps
    window = np.sqrt(np.clip(1 - (away / reach) ** 2, 0, None))
    beta = math.pi * reach * (1 - 1 / _OVERSAMPLING)
    kernel = np.sinc(away) * np.i0(beta * window) / np.i0(beta)
    return torch.from_numpy(np.abs(taps)), torch.from_numpy(kernel)


@dataclass
class _HankelCost:
    """Predicts memory and time of a PSF by a Hankel transform or a rim integral.

    nodes: number of nodes in the pupil. spacing: metres between the radii at which the field is
    summed. field_radii: number of these radii. reach: samples on either side that the interpolation
    uses. radii: number of different radii among the samples.
    """

    request: PSFRequest
    nodes: int
    spacing: float
    field_radii: int
    reach: int
    radii: int

    @staticmethod
    def of(q: PSFRequest) -> _HankelCost:
        assert q.lens.stop.annulus_radii is not None
        inner, outer = q.lens.stop.annulus_radii
        spacing = q.scale / (2 * _OVERSAMPLING * q.radius * outer)
        reach = _interpolation_reach(q.tol)
        sums = math.ceil(q.farthest_sample_radius / spacing) + reach + 2
        nodes = line_rule_node_count(outer - inner, _radial_phase_slope(q), q.tol)
        rows, columns = q.samples.shape
        different = rows * columns
        if not any(q.samples.centre):
            # In a centred window every radius occurs four times, or eight times with square pixels.
            times = 8 if q.samples.pitch[0] == q.samples.pitch[1] else 4
            different = different // times + rows + columns
        return _HankelCost(q, nodes, spacing, sums, reach, min(different, rows * columns))

    @cached_property
    def samples(self) -> int:
        return self.request.samples.shape[0] * self.request.samples.shape[1]

    def bytes(self, along_rim: bool) -> int:
        rest = 8 * self.radii * self.reach + 6 * self.samples
        return 8 * (rest + (2 * self.field_radii if along_rim else self.field_radii * self.nodes))

    def cpu_seconds(self, speed: MachineSpeed, along_rim: bool) -> float:
        sums = 0.0 if along_rim else self.field_radii * self.nodes * speed.stream
        gathered = 2 * self.radii * self.reach + self.samples / 4
        return speed.call + sums + gathered * speed.gather


def _prefers_rim(q: PSFRequest, size: _HankelCost) -> bool:
    """Tell whether a PSF's rim integral takes far fewer nodes than a rule along the radius."""
    if not q.lens.has_quadratic_phase:
        return False
    return size.nodes * size.field_radii > _CHUNK and size.nodes > 2 * rim_node_count(q, q.tol)


def _interpolation_reach(tol: float) -> int:
    """Return how many samples on either side interpolate a symmetric PSF to a tolerance.

    Kaiser's formula gives their number. Its attenuation is in dB.
    """
    attenuation = 40 - 20 * math.log10(tol)
    return math.ceil((attenuation - 8) / (2 * 2.285 * 2 * math.pi * (1 - 1 / _OVERSAMPLING))) + 2
