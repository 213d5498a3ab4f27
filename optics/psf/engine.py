"""Define PSFEngine, the interface of all methods, and its check that nodes resolve a pattern."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from optics.accuracy import (
    FLOAT32_ARITHMETIC,
    FLOAT64_ARITHMETIC,
    CandidateMethod,
    ErrorEstimate,
    ToleranceError,
)
from optics.fourier.differentiation import apply_function
from optics.psf.dim_windows import EvenNoise, window_norm
from optics.psf.request import PSFRequest
from optics.validation import records_gradient, require_finite, rounded_down, rounded_up

_BLOCK_SAMPLES = 1 << 16
"""Samples of a phase that are processed at a time, so that they fit in the cache."""


_SLOPE_MARGIN = 1.05
"""Factor by which a phase may be steeper than planned. Chosen."""

_SLOPE_SAMPLES = 3000
"""Points at which the slope is evaluated. Chosen."""

_NEIGHBOURS = 7
"""Nearest points to each of them, itself included, to which slopes are measured. Chosen."""

_SLOW_VARIATION = 3.0
"""Slope of the waves by which a phase may vary without further nodes, radians per stop radius.
Chosen: the nodes have harmonics to spare for it."""

_SPARE_SLOPE = 5.0
"""Slope, radians per stop radius, for which nodes are to spare. Chosen."""

_PATTERN_ERROR_FACTOR = 3.0
"""Factor on the error that is told of a pattern's light, from that without a pattern. Chosen; 2.2
was needed among 50 random patterns."""

_BRIGHT_SAMPLES = 300
"""Brightest points of an amplitude at which its detail is measured besides. Chosen."""


class PSFEngine(CandidateMethod):
    """Computes the light of a point on the sensor; the base class of all methods.

    An engine states its memory and processor time before it allocates anything large. `prepare()`
    allocates it, measures the error, and raises ToleranceError if the error is too large. Then
    `intensity()` returns the share of the light on every sample, (..., rows, columns).

    name, sampling, precision: descriptions in words.
    error: of the sampling; known after `prepare()`.
    arithmetic: relative L2 error from rounding.
    """

    sampling: str
    precision: str
    error: ErrorEstimate
    arithmetic: float
    earlier_seconds: float = 0.0
    """Predicted processor seconds of other methods that were prepared before this one, in vain."""

    _stand_in: PSFEngine | None = None
    """The engine that computed the light of the last call in this one's place, if any did."""

    @property
    def used_engine(self) -> PSFEngine:
        """The engine that computed the light of the last call: itself, or one that stood in."""
        return self if self._stand_in is None else self._stand_in.used_engine

    _dtype: torch.dtype
    _request: PSFRequest
    _neighbour_pairs: NeighbourPairs | None = None
    _interpolation: NeighbourInterpolation | None = None
    _planned_error: ErrorEstimate
    _even_noise: float = 0.0
    _kept_light: torch.Tensor | None = None

    @property
    def sample_count(self) -> int:
        """The number of samples at the sensor."""
        rows, columns = self._request.samples.shape
        return rows * columns

    def _set_precision(self, double: bool) -> None:
        """Set the complex type to double or single, and the rounding error."""
        self._dtype = torch.complex128 if double else torch.complex64
        self.precision = "float64" if double else "float32"
        self.arithmetic = FLOAT64_ARITHMETIC if double else FLOAT32_ARITHMETIC

    @abstractmethod
    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the pupil points (y, x), in metres, where a pattern is sampled."""

    @abstractmethod
    def intensity(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> torch.Tensor: ...

    def _keep_first_light(self, light: torch.Tensor) -> None:
        """Keep the light without a pattern that planning has computed, for the first call.

        It is handed out once, so that the memory is free again. With derivatives it isn't kept.
        """
        self._kept_light = None if self._request.differentiable else light
        self._planned_error = self.error
        norm = window_norm(light.detach(), self._request.window_slices)
        rows, columns = self._request.window_slices
        total = float(light.detach()[..., rows, columns].sum(dtype=torch.float64))
        # Errors that spread like noise of this mean square make the planned error of this light.
        error = self.error.value * float(norm)
        self._even_noise = error**2 / (2 * total) if total > 0 else 0.0

    def _tell_pattern_error(self, light: torch.Tensor) -> None:
        """Tell the error of light with a pattern, which may send less of it to the window.

        The errors of nodes and transforms are taken to be as large as without a pattern. Raises
        ToleranceError if they are too large for this light.
        """
        q, window = self._request.numeric, self._request.window_slices
        tol = self._pattern_tol
        seen = light.detach()
        noise = EvenNoise(seen, None, window, window_norm(seen, window))
        error = noise.error(torch.tensor(self._even_noise))
        error = _PATTERN_ERROR_FACTOR * max(self._planned_error.value, error)
        self.error = ErrorEstimate(error, "estimate from the light in the window")
        if not error + self.arithmetic <= tol:
            remedy = f"tol={rounded_down(0.5 * tol * tol / error)}"
            if q.pattern_tol is None:
                remedy = f"phase_slope={q.phase_slope:g}, so that patterns are planned for"
            raise ToleranceError(
                f"tol {tol:g} can't be kept: the pattern sends little light to the window, of "
                f"which errors are {error:.2g}; plan a PSFOperator with {remedy}, or ask for a "
                "larger window"
            )

    @property
    def _pattern_tol(self) -> float:
        """The relative L2 error that light with a pattern must keep."""
        q = self._request
        return q.tol if q.pattern_tol is None else q.pattern_tol

    def _first_light(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> torch.Tensor | None:
        """Return the kept light for the first call without a pattern, or None."""
        if phase is not None or amplitude is not None:
            return None
        light, self._kept_light = self._kept_light, None
        return light

    def modulation_factor(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        samples: Sequence[int],
        dtype: torch.dtype = torch.complex128,
    ) -> torch.Tensor | None:
        """Return a pattern as one complex factor, or None without a pattern.

        The factor is the amplitude times exp(i phase), with the phase in radians.
        """
        if phase is None and amplitude is None:
            return None
        factor: torch.Tensor | None = None
        if phase is not None:
            require_sample_shape("phase", phase, samples)
            if phase.is_complex():
                raise ValueError(
                    f"phase is {phase.dtype}; it is real, in radians; amplitude may absorb"
                )
            factor = phase_factor(phase, dtype)
        if amplitude is not None:
            require_sample_shape("amplitude", amplitude, samples)
            strength = amplitude.to(dtype)
            factor = strength if factor is None else factor * strength
        return factor

    def require_resolved(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> None:
        """Raise ValueError for a pattern whose detail the nodes don't resolve."""
        given = [one for one in (phase, amplitude) if one is not None and one.numel()]
        if not given:
            return
        q = self._request.numeric
        if self._interpolation is None:
            y, x = (p / q.radius for p in self.points())
            self._neighbour_pairs = NeighbourPairs(y, x)
            self._interpolation = NeighbourInterpolation(y, x, q.phase_slope)
        needed, names = 0.0, []
        if phase is not None and phase.numel():
            names.append("phase")
            needed += self._phase_bandwidth(phase.detach(), self._neighbour_pairs)
        if amplitude is not None and amplitude.numel():
            names.append("amplitude")
            # An amplitude has no steepest slope. Where its spectrum falls as a Gaussian does, this
            # factor leads from the root mean square to where the tolerance is reached.
            factor = math.sqrt(max(1.0, -math.log(self._pattern_tol)))
            detail = factor * self._interpolation.detail_slope(amplitude.detach())
            needed += max(detail - _SPARE_SLOPE, 0.0)
        if needed > _SLOPE_MARGIN * q.phase_slope:
            raise ValueError(
                f"{' and '.join(names)} turns by {needed:.3g} radians per stop radius, detail "
                f"included, and {q.phase_slope:g} were planned for; plan a PSFOperator with "
                f"phase_slope={rounded_up(needed)}"
            )

    def _phase_bandwidth(self, phase: torch.Tensor, pairs: NeighbourPairs | None) -> float:
        """Return the slope of the finest detail of exp(i phase), radians per stop radius.

        It is the steepest slope s and, for a phase that varies like a wave of slope k, as many more
        of its harmonics as have amplitudes above the tolerance: Bessel functions of s / k. The
        nodes have harmonics to spare for a slow variation.
        """
        assert pairs is not None
        assert self._interpolation is not None
        slope = pairs.steepest_slope(phase)
        if not slope > 0:
            return 0.0
        variation = self._interpolation.phase_variation(phase, slope)
        harmonics = 2.5 * (slope / max(variation, 1e-9)) ** (1 / 3)
        harmonics -= 1.2 * math.log10(self._pattern_tol)
        return slope + max(variation - _SLOW_VARIATION, 0.0) * harmonics


class CachedPupilWave(ABC):
    """Computes a point's wave in the pupil at the first call and caches it.

    With derivatives the wave is computed at every call, because a cached tensor would belong to the
    graph of an earlier call.
    """

    _request: PSFRequest
    _cached_wave: torch.Tensor | None = None

    @abstractmethod
    def _compute_pupil_wave(self) -> torch.Tensor:
        """Compute the object point's wave in the pupil, behind the stop."""

    def _pupil_wave(self) -> torch.Tensor:
        if self._request.differentiable:
            return self._compute_pupil_wave()
        if self._cached_wave is None:
            self._cached_wave = self._compute_pupil_wave()
        return self._cached_wave


def wrap_phase(angle: torch.Tensor) -> torch.Tensor:
    """Wrap a phase to -pi to pi radians without changing its derivative."""
    turns = torch.round(angle.detach() * (1 / (2 * math.pi)))
    return torch.add(angle, turns, alpha=-2 * math.pi)


def phase_factor(phase: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """Compute exp(i phase) in a complex type; differentiable in the phase.

    Wrapping in float64 keeps the fraction of a wave of a phase of 1e5 waves. Cosine and sine take a
    sixth of the time of torch.polar in single precision, and blocks that fit in the cache less than
    half of that of a whole panel.
    """
    if not records_gradient(phase):
        return _phase_factor(phase.detach(), dtype)
    return apply_function(_PhaseFactor, phase, dtype)


class _PhaseFactor(torch.autograd.Function):
    """The autograd function of exp(i phase), which keeps the factor alone."""

    @staticmethod
    def forward(ctx: Any, phase: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
        factor = _phase_factor(phase.detach(), dtype)
        ctx.save_for_backward(factor)
        ctx.phase_dtype = phase.dtype
        return factor

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        (factor,) = ctx.saved_tensors
        change = factor.real * gradient.imag - factor.imag * gradient.real
        return change.to(ctx.phase_dtype), None


def squared_modulus(field: torch.Tensor, scale: torch.Tensor | float) -> torch.Tensor:
    """Compute ``|field|²`` times a scale; differentiable in both."""
    if records_gradient(field) and not isinstance(scale, torch.Tensor):
        return apply_function(_SquaredModulus, field, scale)
    return (field.real**2 + field.imag**2) * scale


class _SquaredModulus(torch.autograd.Function):
    """The autograd function of an intensity, with few passes over the samples."""

    @staticmethod
    def forward(ctx: Any, field: torch.Tensor, scale: float) -> torch.Tensor:
        ctx.save_for_backward(field)
        ctx.scale = scale
        return (field.real**2).addcmul_(field.imag, field.imag).mul_(scale)

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        (field,) = ctx.saved_tensors
        # A real factor on a complex tensor would be copied to complex numbers first.
        weighted = torch.view_as_real(field.resolve_conj()) * (2 * ctx.scale * gradient)[..., None]
        return torch.view_as_complex(weighted), None


def _phase_factor(phase: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """Compute exp(i phase), without derivatives, in blocks."""
    if phase.numel() <= _BLOCK_SAMPLES:
        return _phase_factor_of_block(phase, dtype)
    factor = torch.empty(phase.shape, dtype=dtype, device=phase.device)
    blocks = torch.split(phase.reshape(-1), _BLOCK_SAMPLES)
    for block, out in zip(blocks, torch.split(factor.view(-1), _BLOCK_SAMPLES), strict=True):
        out.copy_(_phase_factor_of_block(block, dtype))
    return factor


def _phase_factor_of_block(phase: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    angle = wrap_phase(phase.to(torch.float64)).to(dtype.to_real())
    return torch.complex(torch.cos(angle), torch.sin(angle))


def _rounding(phase: torch.Tensor) -> float:
    """Return by how much a phase may be off where it was computed in its own precision.

    Two of the last digits of its largest number, in radians. Whole numbers are as they are.
    """
    if not phase.is_floating_point():
        return 0.0
    return 2 * torch.finfo(phase.dtype).eps * float(phase.detach().abs().max())


class NeighbourPairs:
    """Finds pairs of neighbouring points in the pupil, to measure how steep a phase is.

    y, x: in stop radii, one-dimensional, or a column and a row. A random sample of points is used.
    """

    def __init__(self, y: torch.Tensor, x: torch.Tensor) -> None:
        shape = (y + x).shape
        self._point_count = math.prod(shape)
        places = torch.stack([p.expand(shape).ravel() for p in (y, x)], dim=1).numpy()
        rng = np.random.default_rng(0)
        count = min(_SLOPE_SAMPLES, self._point_count)
        some = rng.choice(self._point_count, count, replace=False)
        neighbours = min(_NEIGHBOURS, self._point_count)
        found = cKDTree(places).query(places[some], k=neighbours)
        away, near = (np.reshape(part, (some.size, -1))[:, 1:].copy() for part in found)
        self._distances, self._neighbour_indices = torch.from_numpy(away), torch.from_numpy(near)
        self._sampled_indices = torch.from_numpy(some)

    def steepest_slope(self, phase: torch.Tensor) -> float:
        """Return a phase's steepest slope between neighbouring points, radians per stop radius.

        phase: (..., points), radians.
        """
        flat = phase.cpu().to(torch.float64).reshape(-1, self._point_count)
        turn = wrap_phase(flat[:, self._neighbour_indices] - flat[:, self._sampled_indices, None])
        # Over the spacing of close nodes, rounding alone would look steep.
        steps = (turn.abs() - 2 * _rounding(phase)).clamp(min=0.0)
        far = self._distances > 0
        return float((steps / self._distances)[:, far].max()) if far.any() else 0.0


class NeighbourInterpolation:
    """Measures how fine an amplitude's detail is, by interpolating it from neighbouring points.

    What a linear interpolation misses grows with the square of the slope that plane waves have. So
    the root mean square of what it misses, compared with that of plane waves on the same points,
    tells the slope of the detail, also of a spot that is seen at a single point.

    y, x: pupil points in stop radii, one-dimensional, or a column and a row. A random sample is
    used, and for every amplitude its brightest points.
    slope: radians per stop radius of the plane waves to compare with.
    """

    def __init__(self, y: torch.Tensor, x: torch.Tensor, slope: float) -> None:
        shape = (y + x).shape
        self._places = np.stack([p.expand(shape).ravel().numpy() for p in (y, x)], axis=1)
        self._tree, self._slope = cKDTree(self._places), slope
        count = min(_SLOPE_SAMPLES, len(self._places))
        some = np.random.default_rng(0).choice(len(self._places), count, replace=False)
        self._sample = some, *self._weights(some)
        angles = np.arange(4) * (math.pi / 4)
        waves = np.exp(1j * slope * (self._places @ np.stack([np.sin(angles), np.cos(angles)]))).T
        self._missed_by_waves = math.sqrt(
            np.mean([self._missed_share(wave, *self._sample) ** 2 for wave in waves])
        )

    def detail_slope(self, amplitude: torch.Tensor) -> float:
        """Return the slope of plane waves with as fine detail, radians per stop radius.

        The largest of a batch counts.

        amplitude: (..., points).
        """
        flat = amplitude.cpu().reshape(-1, len(self._places)).resolve_conj().numpy()
        found = [self._missed_by_interpolation(values.astype(np.complex128)) for values in flat]
        least = np.finfo(np.float64).eps
        return self._slope * math.sqrt(max(found) / max(self._missed_by_waves, least))

    def phase_variation(self, phase: torch.Tensor, slope: float) -> float:
        """Return the slope of the waves by which a phase varies, radians per stop radius.

        A wave of slope k whose steepest slope is s bends by k s at most, and by k s / sqrt(2) in
        the root mean square. What interpolation misses of the phase is compared with what it misses
        of a parabola, which bends by 1 everywhere. The largest of a batch counts.

        phase: (..., points), radians.
        slope: s, its steepest slope.
        """
        at, near, weights = self._sample
        flat = phase.cpu().to(torch.float64).reshape(-1, len(self._places))
        turned = wrap_phase(flat[:, near] - flat[:, at, None]).numpy()
        rounded = (1 + (weights**2).sum(-1)).mean() * _rounding(phase) ** 2
        missed = np.sqrt(np.maximum(((weights * turned).sum(-1) ** 2).mean(1) - rounded, 0.0))
        parabola = (self._places**2).sum(1) / 2
        bent = (weights * (parabola[near] - parabola[at][:, None])).sum(1)
        # Half of the parabola's bend lies along either axis.
        size = float(np.sqrt((bent**2).mean())) / math.sqrt(2)
        return float(missed.max()) / size * math.sqrt(2) / slope if size > 0 else 0.0

    def _missed_by_interpolation(self, values: NDArray[np.complex128]) -> float:
        """Return the share of an amplitude that interpolation misses."""
        if not values.any():
            return 0.0
        count = min(_BRIGHT_SAMPLES, values.size)
        bright = np.argpartition(np.abs(values), -count)[-count:]
        return max(
            self._missed_share(values, *self._sample),
            self._missed_share(values, bright, *self._weights(bright)),
        )

    @staticmethod
    def _missed_share(
        values: NDArray[np.complex128],
        at: NDArray[np.int64],
        near: NDArray[np.int64],
        weights: NDArray[np.float64],
    ) -> float:
        missed = values[at] - (weights * values[near]).sum(1)
        size = float(np.linalg.norm(values[at]))
        return float(np.linalg.norm(missed)) / size if size > 0 else 0.0

    def _weights(self, at: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return neighbours of points, and weights for their interpolation.

        The weights are the smallest that reproduce linear functions.
        """
        neighbours = min(_NEIGHBOURS, len(self._places))
        away, near = self._tree.query(self._places[at], k=neighbours)
        near = np.reshape(near, (at.size, -1))[:, 1:]
        scale = np.maximum(np.reshape(away, (at.size, -1)).max(1), 1e-300)[:, None, None]
        offsets = (self._places[near] - self._places[at][:, None]) / scale
        linear = np.concatenate([np.ones((*near.shape, 1)), offsets], axis=2)
        return near, np.linalg.pinv(linear)[:, 0]


def double_precision_error(request: PSFRequest) -> float:
    """Return the relative L2 rounding error of double precision.

    The larger the phase in radians, the fewer digits of its fraction double precision holds.
    """
    slope = request.numeric.phase_slope_bound.largest_slope(1.0)
    return 10 * FLOAT64_ARITHMETIC + 4e-16 * slope


def require_sample_shape(name: str, value: torch.Tensor, samples: Sequence[int]) -> None:
    """Raise ValueError for a pattern that isn't finite or doesn't fit the samples."""
    if tuple(value.shape[-len(samples) :]) != tuple(samples):
        raise ValueError(
            f"{name} is {tuple(value.shape)}; the pupil has {tuple(samples)} "
            f"{'pixels' if len(samples) == 2 else 'points'}"
        )
    require_finite(name, value)
