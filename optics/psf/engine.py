"""Define what all engines have in common: those of a lens, and those behind a panel."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch

from optics.accuracy import (
    FLOAT32_ARITHMETIC,
    FLOAT64_ARITHMETIC,
    CandidateMethod,
    ErrorEstimate,
    ToleranceError,
)
from optics.psf.dim_windows import AddedLight, EvenNoise, error_beside, window_norm
from optics.psf.pattern_detail import PatternDetail
from optics.psf.phase_factor import phase_factor
from optics.psf.request import PSFRequest
from optics.validation import require_finite, rounded_down, rounded_up

_SLOPE_MARGIN = 1.05  # factor by which a phase may be steeper than planned. Chosen.

# Factor on the error that is told of a pattern's light, from that without a pattern. Chosen; 2.2
# was needed among 50 random patterns.
_PATTERN_ERROR_FACTOR = 3.0


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
    _detail: PatternDetail | None = None
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
        given = {"phase": phase, "amplitude": amplitude}
        patterns = {name: one.detach() for name, one in given.items() if one is not None}
        patterns = {name: one for name, one in patterns.items() if one.numel()}
        if not patterns:
            return
        q = self._request.numeric
        if self._detail is None:
            y, x = (p / q.radius for p in self.points())
            self._detail = PatternDetail(y, x, q.phase_slope, self._pattern_tol)
        needed = 0.0
        if "phase" in patterns:
            needed += self._detail.phase_slope(patterns["phase"])
        if "amplitude" in patterns:
            needed += self._detail.amplitude_slope(patterns["amplitude"])
        if needed > _SLOPE_MARGIN * q.phase_slope:
            raise ValueError(
                f"{' and '.join(patterns)} turns by {needed:.3g} radians per stop radius, detail "
                f"included, and {q.phase_slope:g} were planned for; plan a PSFOperator with "
                f"phase_slope={rounded_up(needed)}"
            )


class BehindPanelEngine(PSFEngine):
    """Computes the light of a point behind a panel, part of which the panel may not modulate.

    Both parts are added in intensity, and their error counts together: where one of them is dim in
    the window, its error matters little.
    """

    _own_error: float | None = None

    @property
    def own_error(self) -> float:
        """The relative L2 error of the last call's light without other light that is added."""
        return self.error.value + self.arithmetic if self._own_error is None else self._own_error

    def tell_error(
        self, own: float, norm: torch.Tensor, added: AddedLight | None, rounding: float, how: str
    ) -> float:
        """Tell the error of light together with what is added to it, and return it.

        own: relative L2 error of the light by itself, `rounding` of which is arithmetic.
        norm: its L2 norm in the window, (...).
        """
        self._own_error = own
        error = error_beside(own, norm, added)
        self.error = ErrorEstimate(max(error - rounding, 0.0), how)
        return error

    @abstractmethod
    def intensity(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        added: AddedLight | None = None,
    ) -> torch.Tensor: ...


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
